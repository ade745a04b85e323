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

GEOJSON = "application/geo+json"
FEW_SPOTS = 2000
"""So many are written at once, next to other requests; more take long, and wait for each other."""
_PACKING_LEVEL = 4


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
            return _response(await asyncio.to_thread(_written, believed, rows, version))

    async def _all(self, believed: BelievedSpots, packed: bool) -> Response:
        async with self._writing:
            key = (believed.version, believed.sheet, math.floor(believed.now))
            if key != self._key:
                rows = np.arange(len(believed.sheet))
                self._body = await asyncio.to_thread(_written, believed, rows, believed.version)
                self._key, self._packed = key, b""
            if packed and not self._packed:
                self._packed = await asyncio.to_thread(gzip.compress, self._body, _PACKING_LEVEL, mtime=0)
            return _response(self._packed if packed else self._body, packed)


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
