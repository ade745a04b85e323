"""`autowaze cloud`: the service, and the tokens of its cars."""

from __future__ import annotations

import logging
import time
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from autowaze.cli.options import console
from autowaze.cloud.admission import DAY_S, CarefulAdmission, TimelyAdmission
from autowaze.cloud.durable import DurableService
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import open_store, open_tokens
from autowaze.cloud.store.sources import SourceRegister
from autowaze.cloud.store.tokens import Scope
from autowaze.cloud.upkeep import DIFFS_DAYS, HISTORY_DAYS, Retention, Upkeep
from autowaze.world.broker import BrokerAddress
from autowaze.world.errors import AutowazeError
from autowaze.world.map_file import load_map
from autowaze.world.parking import ParkingMap
from autowaze.world.streets import StreetNetwork

app = typer.Typer(invoke_without_command=True, rich_markup_mode="markdown")
token = typer.Typer(no_args_is_help=True, help="Tokens that let cars hand in diffs and fetch the map.")
app.add_typer(token, name="token")

Store = Annotated[
    str,
    typer.Option(
        help="Where accepted diffs, spots and tokens lie: a file, made if there is none, or postgresql://user@host/db.",
        envvar="AUTOWAZE_STORE",
    ),
]
DEFAULT_STORE = "autowaze.db"
DEFAULT_PORT = 8080


@app.callback()
def cloud(
    context: typer.Context,
    spots: Annotated[Path | None, typer.Option(help="Parking map, GeoJSON.", show_default=False)] = None,
    store: Store = DEFAULT_STORE,
    stored_map: Annotated[Path | None, typer.Option("--map", help="Base map to start from.")] = None,
    streets: Annotated[
        Path | None, typer.Option(help="Streets and buildings for the live map and for routes, GeoJSON.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 for all.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 chooses a free one.", min=0, max=65535)] = DEFAULT_PORT,
    method: Annotated[str, typer.Option(help="How spots are decided: thesis or fused.")] = "fused",
    open_to_all: Annotated[bool, typer.Option("--open", help="Take diffs from anyone, without token.")] = False,
    replay: Annotated[
        bool, typer.Option("--replay", help="Take drives of another day; time stands at the newest observation.")
    ] = False,
    certificate: Annotated[Path | None, typer.Option(help="TLS certificate chain, PEM; with --key.")] = None,
    key: Annotated[Path | None, typer.Option(help="Its private key, PEM.")] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            help="Broker at which cars hand in diffs, too: mqtt[s]://[user:password@]host.", envvar="AUTOWAZE_MQTT"
        ),
    ] = None,
    keep_diffs: Annotated[
        float, typer.Option(help="Days that accepted diffs are kept once a snapshot covers them; 0 for ever.", min=0)
    ] = DIFFS_DAYS,
    keep_history: Annotated[
        float, typer.Option(help="Days that changes of spots and the audit log are kept; 0 for ever.", min=0)
    ] = HISTORY_DAYS,
    cors: Annotated[list[str] | None, typer.Option(help="Origin whose web pages may read; all by default.")] = None,
) -> None:
    """Run the service: diffs in; spots, map and changes out.

    Examples:

        autowaze cloud token add car-1

        autowaze cloud --spots street.geojson --map street.map

        autowaze cloud --spots street.geojson --open --replay

        autowaze cloud --spots street.geojson --mqtt mqtts://service:secret@broker.example
    """
    if context.invoked_subcommand is not None:
        return
    if spots is None:
        raise AutowazeError("no parking map: give one with --spots FILE.geojson")
    from autowaze.cloud.api import create_app
    from autowaze.cloud.api.guard import Guard
    from autowaze.cloud.api.server import WebServer, listening_socket

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    parking_map = ParkingMap.from_geojson(spots)
    network = StreetNetwork.from_geojson(streets, parking_map.georeference) if streets else None
    base_map = load_map(stored_map) if stored_map else None
    admit = CarefulAdmission(
        None if open_to_all else SourceRegister(store), None if replay else TimelyAdmission(time.time)
    )
    listening = listening_socket(host, port)
    kept = open_store(store)
    journal = PassJournal()
    durable = DurableService(
        lambda: CloudService(parking_map, method, base_map),
        kept,
        admit=admit,
        observe=journal.note,
        followers={"passes": journal},
    )
    kept.survey(durable.service.spots.parking_map)
    tokens = None if open_to_all else open_tokens(store)
    site = create_app(
        durable,
        parking_map,
        Guard(tokens),
        None if replay else time.time,
        journal,
        surveyed_at=spots.stat().st_mtime,
        origins=cors or ["*"],
        streets=network,
        broker=BrokerAddress.parse(mqtt) if mqtt else None,
    )
    address = f"{'https' if certificate else 'http'}://{host}:{listening.getsockname()[1]}"
    holds = f"{len(durable.service.spots)} spots, {kept.position} diffs in {kept.name}, method {method}"
    server = WebServer(site, certificate, key, lambda: console.print(f"{address}  {holds}"))
    if tokens is not None and not any(known.revoked_at is None for known in tokens.all()):
        console.print(f"no car has a token yet: autowaze cloud token add NAME --store {kept.name}")
    try:
        with Upkeep(durable, Retention(keep_diffs or None, keep_history or None)):
            server.run(sockets=[listening])
    finally:
        kept.close()
        if tokens is not None:
            tokens.close()


@token.command("add")
def add_token(
    name: Annotated[str, typer.Argument(help="What you call the car; it appears nowhere else.")],
    store: Store = DEFAULT_STORE,
    scope: Annotated[list[Scope] | None, typer.Option(help="What it allows; diffs and map by default.")] = None,
    days: Annotated[float | None, typer.Option(help="How long it is good; for ever by default.", min=0)] = None,
) -> None:
    """Make a token and print it; it is shown this once."""
    expires_at = None if days is None else time.time() + days * DAY_S
    with closing(open_tokens(store)) as tokens:
        secret = tokens.add(name, frozenset(scope or (Scope.DIFFS, Scope.MAP)), expires_at)
    console.print(secret, soft_wrap=True)


@token.command("rotate")
def rotate_token(
    name: str,
    store: Store = DEFAULT_STORE,
    grace: Annotated[float, typer.Option(help="Hours for which the old secret is good, too.", min=0, max=720)] = 24.0,
) -> None:
    """Give a token a new secret and print it; sessions and limits go on as they are."""
    with closing(open_tokens(store)) as tokens:
        console.print(tokens.rotate(name, grace * 3600.0), soft_wrap=True)


@token.command("revoke")
def revoke_token(name: str, store: Store = DEFAULT_STORE) -> None:
    """Let a token be good no longer, at once."""
    with closing(open_tokens(store)) as tokens:
        tokens.revoke(name)
    console.print(f"{name}: revoked")


@token.command("list")
def list_tokens(store: Store = DEFAULT_STORE) -> None:
    """Every token, without its secret."""
    table = Table("name", "scopes", "made", "expires", "old secret until", "revoked")
    with closing(open_tokens(store)) as tokens:
        every = tokens.all()
    for known in every:
        times = (known.created_at, known.expires_at, known.old_until, known.revoked_at)
        table.add_row(known.name, ", ".join(sorted(known.scopes)), *("" if t is None else _day(t) for t in times))
    console.print(table)


@app.command("audit")
def audit(
    store: Store = DEFAULT_STORE,
    after: Annotated[int, typer.Option(help="Only entries after this number.", min=0)] = 0,
    limit: Annotated[int, typer.Option(help="At most so many.", min=1)] = 1000,
) -> None:
    """Who did, or was refused, what."""
    table = Table("number", "when", "who", "what", "more")
    with closing(open_store(store)) as kept:
        for entry in kept.audit_entries(after, limit):
            table.add_row(str(entry.number), _day(entry.at), entry.actor, entry.action, entry.detail)
    console.print(table)


def _day(timestamp: float) -> str:
    return datetime.fromtimestamp(timestamp, UTC).strftime("%Y-%m-%d %H:%M")
