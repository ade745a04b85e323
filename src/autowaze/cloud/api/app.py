"""The whole web service: what is made of what, and which routes there are."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager

from fastapi import Depends, FastAPI
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware

from autowaze import __version__
from autowaze.cloud.api.asyncapi import asyncapi_routes
from autowaze.cloud.api.audit import audit_routes
from autowaze.cloud.api.cds import cds_routes
from autowaze.cloud.api.cds_events import Events
from autowaze.cloud.api.changes import ChangeFeed, change_routes
from autowaze.cloud.api.dashboard import Dashboard, dashboard_routes
from autowaze.cloud.api.diff_desk import DiffDesk
from autowaze.cloud.api.feature_map import map_routes
from autowaze.cloud.api.features import feature_routes
from autowaze.cloud.api.fleet import FleetFeed, fleet_routes
from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.history import SpotHistory, history_routes
from autowaze.cloud.api.ingest import DiffCounter, ingest_routes
from autowaze.cloud.api.ingest_socket import ingest_socket_routes
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.map_points import map_point_routes
from autowaze.cloud.api.meters import Meters
from autowaze.cloud.api.mqtt_broadcast import MqttBroadcast
from autowaze.cloud.api.mqtt_gateway import MqttGateway
from autowaze.cloud.api.nearest import ParkingGuide, nearest_routes
from autowaze.cloud.api.operations import operation_routes
from autowaze.cloud.api.parking_editor import ParkingEditor, parking_editor_routes
from autowaze.cloud.api.problems import NEEDS_TOKEN, answer_with_problems
from autowaze.cloud.api.refusals import RefusalLog
from autowaze.cloud.api.security import SecurityHeaders
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spot_collection import SpotCollections
from autowaze.cloud.api.spots import spot_routes
from autowaze.cloud.api.stats import Panel, stats_routes
from autowaze.cloud.api.streets import street_routes
from autowaze.cloud.broadcast import Update
from autowaze.cloud.durable import DurableService
from autowaze.cloud.fleet import Fleet
from autowaze.cloud.nearest import SpotFinder
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.rehearsal import rehearse
from autowaze.cloud.store.tokens import Scope
from autowaze.world.broker import BrokerAddress
from autowaze.world.parking import ParkingMap
from autowaze.world.streets import StreetNetwork

HOUR_S = 3600
PACKED_FROM_BYTES, PACKING_LEVEL = 1400, 4
"""Answers larger than a packet are compressed, quickly."""
_PACKED_ALREADY = (*DEFAULT_EXCLUDED_CONTENT_TYPES, "application/octet-stream")


def create_app(
    durable: DurableService,
    parking_map: ParkingMap,
    guard: Guard,
    clock: Callable[[], float] | None,
    journal: PassJournal,
    surveyed_at: float = 0.0,
    origins: Sequence[str] = ("*",),
    streets: StreetNetwork | None = None,
    broker: BrokerAddress | None = None,
) -> FastAPI:
    """The service as an ASGI application.

    Args:
        durable: takes the diffs; the application has it to itself while it runs.
        parking_map: the spots of the service.
        guard: who may hand in diffs and fetch the map; spots are everyone's.
        clock: seconds since the epoch (UTC); None shows the spots as of the newest observation.
        journal: what `durable` shows its updates to.
        surveyed_at: when the spots were drawn, seconds since the epoch (UTC).
        origins: web pages of these origins may read.
        streets: what the live map shows around the spots, in the map frame of `parking_map`.
        broker: cars may hand in their diffs at this one, too, and follow the spots there.
    """
    feed, meters = ChangeFeed(durable.service.map.version), Meters()
    broadcasts: list[Callable[[Update], None]] = [feed.publish]

    def publish(update: Update) -> None:
        for tell in broadcasts:
            tell(update)

    intake = Intake(durable, publish)
    book = SpotBook(durable.service.spots.parking_map, intake, clock)
    events = Events(journal, intake)
    panel = Panel(book, intake, feed, meters, durable.service.map.feature_count)
    fleet_feed = FleetFeed(Fleet(clock), parking_map.georeference)
    broadcasts += [panel.note, fleet_feed.note]
    history = SpotHistory(durable.store, book, replays=clock is None)
    offers = {"streets": streets is not None, "open": guard.tokens is None}
    dashboard = Dashboard([name for name, offered in offers.items() if offered])
    guard.log = refusals = RefusalLog(durable.store.audit)
    desk = DiffDesk(intake, guard, meters)
    spots_by_mqtt = MqttBroadcast(book, intake) if broker else None
    editor = ParkingEditor(intake, book, feed, durable.store, spots_by_mqtt.redrawn if spots_by_mqtt else None)
    broadcasts += [spots_by_mqtt.note] if spots_by_mqtt else []

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await asyncio.to_thread(rehearse)
        intake.open()
        surveying = asyncio.create_task(asyncio.to_thread(book.sheet.survey))
        async with AsyncExitStack() as stack:
            if broker and spots_by_mqtt:
                await stack.enter_async_context(spots_by_mqtt)
                await stack.enter_async_context(MqttGateway(broker, desk, guard.tokens, spots_by_mqtt.connected))
            yield
            for listeners in app.state.listeners:
                listeners.close()
        await intake.close()
        await asyncio.gather(refusals.written(), surveying)

    app = FastAPI(title="Autowaze", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None)
    app.state.listeners = (feed.listeners, fleet_feed.listeners)
    app.state.counter = counter = DiffCounter(intake, guard, meters)
    app.include_router(ingest_routes(counter))
    app.include_router(ingest_socket_routes(desk, guard))
    for of_map in (map_routes(intake), map_point_routes(intake, parking_map.georeference)):
        app.include_router(of_map, dependencies=[Depends(guard.admits(Scope.MAP))], responses=NEEDS_TOKEN)
    app.include_router(spot_routes(book, SpotCollections(book, history)))
    app.include_router(history_routes(history))
    app.include_router(nearest_routes(ParkingGuide(book, SpotFinder(streets))))
    app.include_router(parking_editor_routes(editor, book, guard))
    app.include_router(street_routes(streets))
    app.include_router(feature_routes(book, dashboard))
    app.include_router(dashboard_routes(dashboard))
    app.include_router(cds_routes(book, events, surveyed_at))
    app.include_router(change_routes(feed))
    app.include_router(fleet_routes(fleet_feed, guard))
    for of_operation in (
        operation_routes(intake, feed, meters),
        stats_routes(panel),
        asyncapi_routes(broker),
        audit_routes(durable.store, guard),
    ):
        app.include_router(of_operation)
    answer_with_problems(app)
    _wrap(app, origins)
    return app


def _wrap(app: FastAPI, origins: Sequence[str]) -> None:
    """What requests and answers pass through; the last one is the outermost."""
    app.add_middleware(
        CORSMiddleware, allow_origins=origins, allow_methods=["GET"], allow_headers=["*"], max_age=HOUR_S
    )
    app.add_middleware(SecurityHeaders)
    app.add_middleware(GZipMiddleware, PACKED_FROM_BYTES, PACKING_LEVEL, exclude_content_types=_PACKED_ALREADY)
