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

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.spot_book import SpotBook
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
        self._book = book
        self._intake = intake
        self._rows_of_tile: dict[Tile, list[int]] = defaultdict(list)
        self._tile_of_row: list[Tile] = []
        for row, (west, south, east, north) in enumerate(book.bounds_lon_lat.tolist()):
            x, y = tiles_of(np.array([[(west + east) / 2, (south + north) / 2]]))[0].tolist()
            self._tile_of_row.append(Tile(x, y))
            self._rows_of_tile[Tile(x, y)].append(row)
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
            row = self._book.row_of[state.spot_id]
            if row < len(self._states):
                self._states[row] = state
            self._changed.add(self._tile_of_row[row])
        self._map_versions.update(dict.fromkeys(update.map_tiles, update.version))
        self._changed_maps.update(update.map_tiles)
        if update.spots or update.map_tiles:
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
        for row in self._rows_of_tile[tile]:
            state = self._states[row]
            west, south, east, north = self._book.bounds_lon_lat[row].tolist()
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
