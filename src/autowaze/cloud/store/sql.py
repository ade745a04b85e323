"""The tables of a store, in the SQL that SQLite and PostgreSQL share."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator

from autowaze.cloud.store.database import ClashError, Database, StoreError
from autowaze.cloud.store.store import Accepted, AuditEntry, SpotChange
from autowaze.world.parking import Occupancy, ParkingMap, SpotState

_ROWS_AT_ONCE = 256
_ROWS_DELETED_AT_ONCE = 1000
_SNAPSHOTS = 2
"""The log is kept from the older one on: should the newest be damaged, nothing is lost."""
_UPSERT = (
    "INSERT INTO spots (spot_id, occupancy, probability_vacant, observed_at, evidence) VALUES (?, ?, ?, ?, ?) "
    "ON CONFLICT (spot_id) DO UPDATE SET occupancy = excluded.occupancy, observed_at = excluded.observed_at, "
    "probability_vacant = excluded.probability_vacant, evidence = excluded.evidence"
)
_NEWEST = (
    "(SELECT number FROM history WHERE history.spot = spot_names.spot AND received_at <= ? "
    "ORDER BY received_at DESC, number DESC LIMIT 1)"
)
_DIFF = "position, session, sequence, received_at, payload"
_CHANGE = "number, received_at, spot, occupancy, probability_vacant, observed_at"
_STATE = "spot_id, occupancy, probability_vacant, observed_at"


class SqlStore:
    """A `Store` in a database. One process writes it; others may read.

    Args:
        log: connection of the thread that takes diffs in.
        side: connection for everything else, so that questions and audits never join the log's transactions.
        clock: seconds since the epoch (UTC), for parking maps.
    """

    def __init__(self, log: Database, side: Database, clock: Callable[[], float] = time.time) -> None:
        self.name = log.name
        self._log = log
        self._side = side
        self._clock = clock
        self._names: dict[str, int] = {}
        self.catch_up()

    @property
    def position(self) -> int:
        """Number of the last diff that this process knows of."""
        return self._position

    @property
    def oldest(self) -> int:
        """Number of the oldest diff that is still in the log; of the next one, if there is none."""
        return int(self._log.execute("SELECT coalesce(min(position), ?) FROM diffs", (self._position + 1,))[0][0])

    def check(self) -> None:
        """Make sure that the database answers."""
        self._log.execute("SELECT 1")

    def catch_up(self) -> None:
        """Read again how far the log goes: a commit of which no answer came may have been kept."""
        self._position = max(self._last("diffs", "position"), self._last("snapshots", "position"))
        self._changes = self._last("history", "number")
        self._names.clear()

    def log(self, after: int = 0) -> Iterator[Accepted]:
        """Diffs after a position, in order."""
        query = f"SELECT {_DIFF} FROM diffs WHERE position > ?"
        while rows := self._log.execute(f"{query} ORDER BY position LIMIT {_ROWS_AT_ONCE}", (after,)):
            for position, session, sequence, received_at, payload in rows:
                after = position
                yield Accepted(session, sequence, received_at, bytes(payload))

    def commit(self, accepted: Iterable[Accepted], changed: Iterable[SpotState]) -> int:
        """Append diffs and changed states in one transaction; raises `StoreError`, and then nothing was kept.

        The position is counted here, not by the database: if another process had written in between, the numbers
        would clash and the transaction fail, instead of two services overwriting each other's state.
        """
        numbered = [
            (position, a.session, a.sequence, a.received_at, a.payload)
            for position, a in enumerate(accepted, start=self._position + 1)
        ]
        changed = list(changed)
        received_at = max((row[3] for row in numbered), default=self._clock())
        try:
            with self._log.transaction():
                self._log.insert("diffs", _DIFF, numbered)
                self._upsert(changed)
                self._note(changed, received_at)
        except ClashError as error:
            self._names.clear()
            raise StoreError(f"{self._log.name}: another process writes this store; stop it first ({error})") from error
        except BaseException:
            self._names.clear()
            raise
        self._position += len(numbered)
        self._changes += len(changed)
        return self._position

    def replace_spots(self, states: Iterable[SpotState]) -> None:
        """Put these states in place of all that are kept."""
        with self._log.transaction():
            self._log.execute("DELETE FROM spots")
            self._upsert(list(states))

    def payload(self, session: int, sequence: int) -> bytes | None:
        """The bytes of the diff with this key."""
        rows = self._log.execute("SELECT payload FROM diffs WHERE session = ? AND sequence = ?", (session, sequence))
        return bytes(rows[0][0]) if rows else None

    def spots(self) -> list[SpotState]:
        """The states kept, in no order."""
        rows = self._side.execute(f"SELECT {_STATE}, evidence FROM spots")
        return [SpotState(spot_id, Occupancy(occupancy), *rest) for spot_id, occupancy, *rest in rows]

    def history(self, start: float, end: float, limit: int, after: int = 0) -> list[SpotChange]:
        """Changes received in a time, by number."""
        rows = self._side.execute(
            f"SELECT number, received_at, {_STATE} FROM history JOIN spot_names ON history.spot = spot_names.spot "
            "WHERE number > ? AND received_at >= ? AND received_at <= ? ORDER BY number LIMIT ?",
            (after, start, end, limit),
        )
        return [SpotChange(n, at, SpotState(s, Occupancy(o), *rest)) for n, at, s, o, *rest in rows]

    def history_extent(self) -> tuple[float, float] | None:
        """When the oldest and the newest change kept were received."""
        low, high = self._side.execute(
            "SELECT (SELECT min(received_at) FROM history), (SELECT max(received_at) FROM history)"
        )[0]
        return None if low is None else (low, high)

    def spots_at(self, time: float) -> list[SpotState]:
        """The newest state per spot received at or before a time."""
        rows = self._side.execute(
            f"SELECT {_STATE} FROM spot_names JOIN history ON history.number = {_NEWEST}", (time,)
        )
        return [SpotState(spot_id, Occupancy(occupancy), *rest) for spot_id, occupancy, *rest in rows]

    def audit(self, entry: AuditEntry) -> None:
        """Note who did what."""
        row = (entry.at, entry.actor, entry.action, entry.detail)
        self._side.execute("INSERT INTO audit (at, actor, action, detail) VALUES (?, ?, ?, ?)", row)

    def audit_entries(self, after: int = 0, limit: int = 1000) -> list[AuditEntry]:
        """Entries after a number, oldest first."""
        query = "SELECT number, at, actor, action, detail FROM audit WHERE number > ? ORDER BY number LIMIT ?"
        return [AuditEntry(*row) for row in self._side.execute(query, (after, limit))]

    def commit_edit(self, geojson: bytes, actor: str, spot_id: str, state: SpotState | None) -> int:
        """Keep an edit of the parking map and what it made of its spot; returns the version of the parking map."""
        now, noted = self._clock(), [state] if state is not None else []
        try:
            with self._log.transaction():
                rows = self._log.execute(
                    "INSERT INTO parking_maps (saved_at, actor, geojson) VALUES (?, ?, ?) RETURNING version",
                    (now, actor, geojson),
                )
                self._log.execute("DELETE FROM spots WHERE spot_id = ?", (spot_id,))
                self._upsert([known for known in noted if known.observed_at is not None])
                self._note(noted, now)
        except BaseException:
            self._names.clear()
            raise
        self._changes += len(noted)
        return int(rows[0][0])

    def spot_edits(self) -> Iterator[bytes]:
        """Every edit of the parking map, oldest first."""
        version, query = 0, "SELECT version, geojson FROM parking_maps WHERE version > ? ORDER BY version"
        while rows := self._log.execute(f"{query} LIMIT {_ROWS_AT_ONCE}", (version,)):
            version = rows[-1][0]
            yield from (bytes(geojson) for _, geojson in rows)

    def save_snapshot(self, position: int, parts: Iterable[bytes]) -> None:
        """Keep the state after a position; of older snapshots the newest stays."""
        self._side.execute("DELETE FROM snapshots WHERE position = ?", (position,))
        self._side.execute("DELETE FROM snapshot_parts WHERE position = ?", (position,))
        sha256 = hashlib.sha256()
        for number, part in enumerate(parts):  # each by itself, so that the log need not wait long
            sha256.update(part)
            self._side.insert("snapshot_parts", "position, part, data", [(position, number, part)])
        row = (position, self._clock(), sha256.digest())
        self._side.insert("snapshots", "position, made_at, sha256", [row])
        kept = [row[0] for row in self._snapshots()[:_SNAPSHOTS]]
        self._side.execute("DELETE FROM snapshots WHERE position < ?", (kept[-1],))
        self._side.execute("DELETE FROM snapshot_parts WHERE position < ?", (kept[-1],))

    def snapshots(self) -> Iterator[tuple[int, bytes]]:
        """Snapshots that are whole, newest first, each with its position."""
        query = "SELECT data FROM snapshot_parts WHERE position = ? ORDER BY part"
        for position, sha256 in self._snapshots():
            data = b"".join(bytes(part) for (part,) in self._side.execute(query, (position,)))
            if hashlib.sha256(data).digest() == bytes(sha256):
                yield position, data

    def prune(self, diffs_before: float, history_before: float) -> int:
        """Delete what was received before times; returns how many diffs that were."""
        snapshots = self._snapshots()
        covered = snapshots[-1][0] if len(snapshots) == _SNAPSHOTS else 0
        pruned = self._delete("diffs", "position", covered, "received_at", diffs_before)
        self._delete("history", "number", self._changes - 1, "received_at", history_before)
        self._delete("audit", "number", self._last("audit", "number"), "at", history_before)
        return pruned

    def tidy(self) -> None:
        """Nothing: a database server does what it needs by itself."""

    def survey(self, parking_map: ParkingMap) -> None:
        """Nothing: a database without geometry has no use for outlines."""

    def close(self) -> None:
        """Let go of both connections."""
        self._side.close()
        self._log.close()

    def _snapshots(self) -> list[tuple[int, bytes]]:
        return [
            (position, sha256)
            for position, sha256 in self._side.execute("SELECT position, sha256 FROM snapshots ORDER BY position DESC")
        ]

    def _delete(self, table: str, key: str, last: int, time_column: str, before: float) -> int:
        """Delete the first rows, up to a key and a time, a few at a time so that the log need not wait long.

        Times ascend with the keys, so that what is kept need not be looked through. Where a clock was set back, a row
        goes with the older ones that came after it.
        """
        count = 0
        first = (
            f"SELECT {key}, {time_column} FROM {table} WHERE {key} <= ? ORDER BY {key} LIMIT {_ROWS_DELETED_AT_ONCE}"
        )
        while old := [row[0] for row in self._side.execute(first, (last,)) if row[1] < before]:
            self._side.execute(f"DELETE FROM {table} WHERE {key} <= ?", (old[-1],))
            count += len(old)
        return count

    def _upsert(self, states: list[SpotState]) -> None:
        rows = [(s.spot_id, s.occupancy.value, s.probability_vacant, s.observed_at, s.evidence) for s in states]
        self._log.execute_many(_UPSERT, rows)

    def _note(self, states: list[SpotState], received_at: float) -> None:
        self._name([state.spot_id for state in states])
        rows = [
            (number, received_at, self._names[s.spot_id], s.occupancy.value, s.probability_vacant, s.observed_at)
            for number, s in enumerate(states, start=self._changes + 1)
        ]
        self._log.insert("history", _CHANGE, rows)

    def _name(self, spot_ids: list[str]) -> None:
        """Give each spot a number: a history of numbers is a third of the size."""
        if not self._names:
            self._names = {spot_id: spot for spot, spot_id in self._log.execute("SELECT spot, spot_id FROM spot_names")}
        first = len(self._names) + 1
        new = [(n, spot_id) for n, spot_id in enumerate((s for s in spot_ids if s not in self._names), start=first)]
        self._log.insert("spot_names", "spot, spot_id", new)
        self._names.update({spot_id: spot for spot, spot_id in new})

    def _last(self, table: str, column: str) -> int:
        return int(self._log.execute(f"SELECT coalesce(max({column}), 0) FROM {table}")[0][0])
