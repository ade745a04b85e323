"""What changed, to whoever listens at the broker: for each tile one retained document of its spots and one with the
version of its map, replaced as they change."""

from __future__ import annotations

import asyncio
import json
import logging
from collections import defaultdict
from contextlib import suppress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.broadcast import Update
from autowaze.cloud.service import CloudService
from autowaze.world.broker import map_topic, spots_topic
from autowaze.world.broker_session import BrokerError, BrokerSession
from autowaze.world.parking import SpotState
from autowaze.world.tiles import TILE_ZOOM, Tile, tiles_of

PAUSE_S = 0.1
"""Changes of a tile within this time go out as one."""

_log = logging.getLogger(__name__)


class MqttBroadcast:
    """Publishes the tiles whose spots changed; all of them to a broker that was just connected to, it may be empty.

    Args:
        book: the spots and where they are.
        intake: where their states are asked for once.
    """

    def __init__(self, book: SpotBook, intake: Intake) -> None:
        self._sheet = book.sheet
        self._intake = intake
        self._tile_of_row = [_tile(bounds) for bounds in self._sheet.bounds_lon_lat]
        self._rows_of_tile = _rows_of(self._tile_of_row)
        self._states: list[SpotState] = []
        self._version = 0
        self._map_versions: dict[Tile, int] = {}
        self._changed: set[Tile] = set()
        self._changed_maps: set[Tile] = set()
        self._wanted = asyncio.Event()
        self._session: BrokerSession | None = None
        self._publishing: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Learn the states and begin to publish."""
        self._states, self._version, self._map_versions = await self._intake.ask(_state_of)
        self._publishing = asyncio.create_task(self._publish_for_ever())
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Stop."""
        if self._publishing is not None:
            self._publishing.cancel()
            await asyncio.gather(self._publishing, return_exceptions=True)

    def connected(self, session: BrokerSession) -> None:
        """Publish all to a broker."""
        self._session = session
        self._changed.update(self._rows_of_tile)
        self._changed_maps.update(self._map_versions)
        self._wanted.set()

    def note(self, update: Update) -> None:
        """Publish soon what an update changed."""
        self._version = update.version
        for state in update.spots:
            row = self._sheet.row_of.get(state.spot_id)
            if row is None:  # it was erased a moment ago
                continue
            if row < len(self._states):
                self._states[row] = state
            self._changed.add(self._tile_of_row[row])
        self._map_versions.update(dict.fromkeys(update.map_tiles, update.version))
        self._changed_maps.update(update.map_tiles)
        if update.spots or update.map_tiles:
            self._wanted.set()

    def redrawn(self, sheet: SpotSheet, spot_id: str, state: SpotState | None) -> None:
        """Publish soon a spot that was drawn, or that one was erased; `sheet` is where the spots lie from now on."""
        row = self._sheet.row_of.get(spot_id, len(self._tile_of_row))
        self._changed.update(self._tile_of_row[row : row + 1])
        self._tile_of_row[row : row + 1] = [] if state is None else [_tile(sheet.bounds_lon_lat[row])]
        self._states[row : row + 1] = [] if state is None else [state]
        self._changed.update(self._tile_of_row[row : row + 1] if state is not None else [])
        self._rows_of_tile = _rows_of(self._tile_of_row)
        self._sheet = sheet
        self._wanted.set()

    async def _publish_for_ever(self) -> None:
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            session = self._session
            with suppress(BrokerError):  # all goes out again once there is a broker
                while session and self._changed:
                    tile = self._changed.pop()
                    session.publish(spots_topic(TILE_ZOOM, *tile), self._document(tile), retain=True)
                    await asyncio.sleep(0)
                while session and self._changed_maps:
                    tile = self._changed_maps.pop()
                    notice = f'{{"version":{self._map_versions[tile]}}}'.encode()
                    session.publish(map_topic(TILE_ZOOM, *tile), notice, retain=True)
                    await asyncio.sleep(0)
            await asyncio.sleep(PAUSE_S)

    def _document(self, tile: Tile) -> bytes:
        spots = []
        for row in self._rows_of_tile.get(tile, []):
            state = self._states[row]
            west, south, east, north = self._sheet.bounds_lon_lat[row].tolist()
            spots.append(
                {
                    "spot_id": state.spot_id,
                    "lon": round((west + east) / 2, 7),
                    "lat": round((south + north) / 2, 7),
                    "state": state.occupancy.value,
                    "probability_vacant": round(state.probability_vacant, 4),
                    "observed_at": state.observed_at,
                }
            )
        document = {"tile": [TILE_ZOOM, *tile], "version": self._version, "spots": spots}
        return json.dumps(document, separators=(",", ":")).encode()


def _state_of(service: CloudService) -> tuple[list[SpotState], int, dict[Tile, int]]:
    tiles = {tile: record.version for tile, record in service.map.tiles.records.items()}
    return service.states, service.map.version, tiles


def _tile(bounds: NDArray[np.float64]) -> Tile:
    """The tile of the middle of west, south, east, north."""
    x, y = tiles_of((bounds[None, :2] + bounds[None, 2:]) / 2)[0].tolist()
    return Tile(x, y)


def _rows_of(tiles: list[Tile]) -> dict[Tile, list[int]]:
    rows: dict[Tile, list[int]] = defaultdict(list)
    for row, tile in enumerate(tiles):
        rows[tile].append(row)
    return dict(rows)
