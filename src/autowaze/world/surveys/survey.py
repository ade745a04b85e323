"""Any source that we know becomes a parking map."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from autowaze.world.drawn_spots import DrawnSpots, load_document
from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap
from autowaze.world.streets import StreetNetwork
from autowaze.world.surveys.cds_curbs import is_cds, read_curbs
from autowaze.world.surveys.osm_extract import Box, OsmExtract, read_osm
from autowaze.world.surveys.osm_parking import osm_spots
from autowaze.world.surveys.osm_streets import street_network
from autowaze.world.surveys.polygon_collection import middle_of, read_polygons

OSM_ENDINGS = (".osm", ".osm.bz2", ".osm.gz", ".osm.pbf", ".pbf")


@dataclass(frozen=True)
class Survey:
    """What a source gave.

    Attributes:
        streets: where the source has them.
        left_out: what gave no spot, by reason.
    """

    drawn: DrawnSpots
    streets: StreetNetwork | None
    left_out: Counter[str]


def survey(paths: list[Path], georeference: Georeference | None = None, box: Box | None = None) -> Survey:
    """Read one source; several files of GeoJSON or of CDS count as pages of one.

    Args:
        georeference: origin of the map frame; without one the source's own, else the middle of what it holds.
        box: only what lies in it.

    Raises:
        MapFileError: a file cannot be read, or holds no spots.
    """
    if not paths:
        raise MapFileError("no source: name a file")
    source = ", ".join(str(path) for path in paths)
    if any(str(path).lower().endswith(OSM_ENDINGS) for path in paths):
        if len(paths) > 1:
            raise MapFileError(f"{source}: one OpenStreetMap extract at a time; join them with osmium merge")
        return _of_osm(read_osm(paths[0], box), source, georeference)
    documents = [load_document(path) for path in paths]
    reader = read_curbs if all(is_cds(document) for document in documents) else read_polygons
    drawn, left_out = reader(documents, source, georeference)
    if box is not None:
        drawn, outside = _clipped(drawn, box, source)
        left_out["spots outside the box"] += outside
    return Survey(drawn, None, +left_out)


def _of_osm(extract: OsmExtract, source: str, georeference: Georeference | None) -> Survey:
    rings = [way.lon_lat for way in (*extract.ways, *extract.outlines)]
    if not rings:
        raise MapFileError(f"{source}: no street, parking area or building in it")
    georeference = georeference or middle_of(rings)
    spots, left_out = osm_spots(extract, georeference)
    left_out["ways that leave the extract"] += extract.incomplete
    if not spots:
        reasons = "; ".join(f"{n} {reason}" for reason, n in left_out.most_common(3))
        raise MapFileError(f"{source}: no parking spot in it ({reasons or 'nothing about parking'})")
    return Survey(ParkingMap(tuple(spots), georeference).drawn, street_network(extract, georeference), +left_out)


def _clipped(drawn: DrawnSpots, box: Box, source: str) -> tuple[DrawnSpots, int]:
    """The spots whose first corner lies in the box, and how many do not."""
    inside = shapely.box(*box)
    kept = [row for row, ring in enumerate(drawn.rings) if shapely.intersects_xy(inside, *np.asarray(ring[0]))]
    if not kept:
        raise MapFileError(f"{source}: no spot in the box")
    clipped = replace(
        drawn,
        ids=tuple(drawn.ids[row] for row in kept),
        kinds=tuple(drawn.kinds[row] for row in kept),
        rings=tuple(drawn.rings[row] for row in kept),
    )
    return clipped, len(drawn) - len(kept)
