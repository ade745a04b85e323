"""All spots, or those in a box, as one GeoJSON document: made once a second at most, however many ask for it."""

from __future__ import annotations

import asyncio
import gzip
import json
import math

import numpy as np
import shapely
from fastapi import Response
from numpy.typing import NDArray

from autowaze.cloud.api.history import SpotHistory
from autowaze.cloud.api.spot_book import BelievedSpots, SpotBook
from autowaze.cloud.api.spot_sheet import SpotSheet

GEOJSON = "application/geo+json"
FEW_SPOTS = 2000
"""So many are written at once, next to other requests; more take long, and wait for each other."""
_PACKING_LEVEL = 4


class FixedTexts:
    """Writes many spots: what stays the same of each is written once for all."""

    def __init__(self) -> None:
        self._sheet: SpotSheet | None = None
        self._before: list[str] = []

    def written(self, believed: BelievedSpots, rows: NDArray[np.int64], version: int | None) -> bytes:
        """The same document as of `BelievedSpots.feature`; one thread at a time."""
        if self._sheet is not believed.sheet:
            self._sheet, self._before = believed.sheet, _beginnings(believed.sheet)
        states = believed.states
        columns = (
            rows.tolist(),
            states.occupancies(rows),
            np.round(states.probabilities(rows), 4).tolist(),
            states.observed_at(rows),
        )
        features = []
        for row, occupancy, vacant, seen in zip(*columns, strict=True):
            age = "null" if seen is None else round(max(believed.now - seen, 0.0), 1)
            at = "null" if seen is None else seen
            features.append(
                f'{self._before[row]}"state":"{occupancy.value}","probability":{vacant},"observed_at":{at},"age_s":{age}}}}}'
            )
        head = json.dumps({"type": "FeatureCollection", "map_version": version}, separators=(",", ":"))
        return f'{head[:-1]},"features":[{",".join(features)}]}}'.encode()


class SpotCollections:
    """Writes spots as documents.

    Args:
        book: the spots now.
        history: the spots then.
    """

    def __init__(self, book: SpotBook, history: SpotHistory) -> None:
        self._book = book
        self._history = history
        self._writing = asyncio.Lock()
        self._key: tuple[object, ...] = ()
        self._body = b""
        self._texts = FixedTexts()
        self._packed = b""

    async def now(self, box: shapely.Geometry | None, packed: bool) -> Response:
        """Spots now; all, or those that a box touches."""
        believed = await self._book.believed()
        if box is None:
            return await self._all(believed, packed)
        rows = await asyncio.to_thread(_rows_in, believed, box)
        return await self._some(believed, rows, believed.version)

    async def at(self, time: float, box: shapely.Geometry | None) -> Response:
        """Spots as they were believed at a time in seconds since the epoch (UTC)."""
        believed = await self._history.believed_at(time)
        rows = np.arange(len(believed.sheet)) if box is None else await asyncio.to_thread(_rows_in, believed, box)
        return await self._some(believed, rows, None)

    async def _some(self, believed: BelievedSpots, rows: NDArray[np.int64], version: int | None) -> Response:
        if len(rows) <= FEW_SPOTS:
            return _response(_written(believed, rows, version))
        async with self._writing:
            return _response(await asyncio.to_thread(self._texts.written, believed, rows, version))

    async def _all(self, believed: BelievedSpots, packed: bool) -> Response:
        async with self._writing:
            key = (believed.version, believed.sheet, math.floor(believed.now))
            if key != self._key:
                rows = np.arange(len(believed.sheet))
                self._body = await asyncio.to_thread(self._texts.written, believed, rows, believed.version)
                self._key, self._packed = key, b""
            if packed and not self._packed:
                self._packed = await asyncio.to_thread(gzip.compress, self._body, _PACKING_LEVEL, mtime=0)
            return _response(self._packed if packed else self._body, packed)


def _beginnings(sheet: SpotSheet) -> list[str]:
    """Each feature up to its state."""
    beginnings = []
    for spot_id, kind, geometry, rectangle in zip(
        sheet.ids, sheet.kinds, sheet.geometries, sheet.rectangles, strict=True
    ):
        properties = {"spot_id": spot_id, "kind": kind, "rectangle": rectangle}
        feature = {"type": "Feature", "id": spot_id, "geometry": geometry, "properties": properties}
        beginnings.append(f"{json.dumps(feature, separators=(',', ':'), allow_nan=False)[:-2]},")
    return beginnings


def _rows_in(believed: BelievedSpots, box: shapely.Geometry) -> NDArray[np.int64]:
    return np.sort(np.asarray(believed.sheet.tree.query(box, predicate="intersects"), dtype=np.int64))


def _written(believed: BelievedSpots, rows: NDArray[np.int64], version: int | None) -> bytes:
    document = {
        "type": "FeatureCollection",
        "map_version": version,
        "features": [believed.feature(row) for row in rows.tolist()],
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _response(body: bytes, packed: bool = False) -> Response:
    headers = {"Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if packed:
        headers["Content-Encoding"] = "gzip"
    return Response(body, media_type=GEOJSON, headers=headers)
