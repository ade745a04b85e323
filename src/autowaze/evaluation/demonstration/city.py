"""Several streets in one map: their spots, what lies around them, and where each of their frames is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.accuracy import SpotTruth, read_truth
from autowaze.traces import open_trace
from autowaze.traces.recorded import PARKING_MAP, STREETS, TRUTH_FOLDER
from autowaze.vehicle.node import StartingPoint
from autowaze.world.drawn_spots import document_of
from autowaze.world.errors import AutowazeError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap
from autowaze.world.streets import Footprints, StreetNetwork, Streets, Trees


@dataclass(frozen=True)
class City:
    """Streets that share a map frame.

    Attributes:
        names: of the streets; a spot is called after its street and its number there.
        parking_map: GeoJSON of all spots.
        streets: GeoJSON of what the live map shows around them.
    """

    georeference: Georeference
    names: tuple[str, ...]
    parking_map: Path
    streets: Path

    def truth(self, drive: Path, street: int) -> list[SpotTruth]:
        """Which spots of a street were free when a drive had ended; opens its ground truth."""
        found = read_truth(drive / TRUTH_FOLDER / "truth.json")
        return [replace(spot, spot_id=_spot_id(self.names[street], spot.spot_id)) for spot in found]

    def true_poses(self, drive: Path) -> NDArray[np.float64]:
        """T_map_cam (N, 4, 4) of a drive in the city's map frame; opens its ground truth."""
        return true_poses(drive, self.georeference)


def found_city(surveys: Sequence[Path], georeference: Georeference, folder: Path) -> City:
    """Join what the surveys of the streets say of spots and surroundings into two files in a folder."""
    networks = [StreetNetwork.from_geojson(survey / STREETS, georeference) for survey in surveys]
    names = tuple(str(network.streets.name[0]).removesuffix(" Street") for network in networks)
    maps = [ParkingMap.from_geojson(survey / PARKING_MAP, georeference) for survey in surveys]
    spots = [
        replace(spot, id=_spot_id(name, spot.id)) for name, own in zip(names, maps, strict=True) for spot in own.spots
    ]
    city = City(georeference, names, folder / PARKING_MAP, folder / STREETS)
    document = document_of(ParkingMap(tuple(spots), georeference).drawn)
    city.parking_map.write_text(json.dumps(document), encoding="utf-8")
    StreetNetwork(
        georeference,
        Streets.concatenate([network.streets for network in networks]),
        Footprints.concatenate([network.buildings for network in networks]),
        Footprints.concatenate([network.areas for network in networks]),
        Trees.concatenate([network.trees for network in networks]),
    ).to_geojson(city.streets)
    return city


def surveyed_start(drive: Path, georeference: Georeference) -> StartingPoint:
    """Where a survey car sets out, which surveyors know; nothing else of the truth."""
    return StartingPoint(georeference, true_poses(drive, georeference)[0])


def true_poses(drive: Path, georeference: Georeference) -> NDArray[np.float64]:
    """T_map_cam (N, 4, 4) of a simulated drive in another map frame than its own."""
    own, truth = ParkingMap.from_geojson(drive / PARKING_MAP).georeference, open_trace(drive).ground_truth
    if truth is None:
        raise AutowazeError(f"{drive}: has no ground truth")
    return np.asarray(georeference.pose_of(own) @ truth.T_world_cam)


def _spot_id(street: str, spot_id: str) -> str:
    return f"{street}-{spot_id}"
