"""What every store promises, whichever database it lies in."""

import itertools

import pytest
from street import Street

from autowaze.cloud.store import Accepted, AuditEntry, StoreError, open_store, open_tokens
from autowaze.cloud.store.tokens import Scope
from autowaze.world.parking import Occupancy, SpotState

VACANT, OCCUPIED = Occupancy.VACANT, Occupancy.OCCUPIED


def diff(number, received_at=1.0):
    return Accepted(7, number, received_at, bytes([number, 0, 255]))


def state(spot_id, occupancy=VACANT, observed_at=1.5, evidence="seen"):
    return SpotState(spot_id, occupancy, 0.1 + 0.2, observed_at, evidence)


def by_id(states):
    return {state.spot_id: state for state in states}


def without_evidence(states):
    return [SpotState(s.spot_id, s.occupancy, s.probability_vacant, s.observed_at) for s in states]


class Conformance:
    """The promises; each kind of store has a class with an `address` fixture."""

    @pytest.fixture
    def store(self, address):
        store = open_store(address)
        yield store
        store.close()

    def test_begins_empty(self, store):
        assert store.position == 0
        assert not list(store.log())
        assert not store.spots()
        assert not store.spots_at(1e9)
        assert not store.history(0.0, 1e9, 10)
        assert store.history_extent() is None
        assert not list(store.spot_edits())

    def test_log_and_spots_outlive_the_connection(self, store, address):
        assert store.commit([diff(0), diff(1)], [state("a"), state("b", OCCUPIED)]) == 2
        assert store.commit([diff(2)], [state("a", OCCUPIED, None)]) == 3
        store.close()
        again = open_store(address)
        assert again.position == 3
        assert list(again.log()) == [diff(0), diff(1), diff(2)]
        assert list(again.log(after=2)) == [diff(2)]
        assert by_id(again.spots()) == by_id([state("a", OCCUPIED, None), state("b", OCCUPIED)])
        assert again.commit([diff(3)], [state("c")]) == 4
        again.close()

    def test_a_failed_commit_keeps_nothing(self, store):
        store.commit([diff(0)], [state("a")])
        with pytest.raises(StoreError):
            store.commit([diff(1), diff(0)], [state("a", OCCUPIED), state("new")])
        assert store.position == 1
        assert list(store.log()) == [diff(0)]
        assert store.spots() == [state("a")]
        assert len(store.history(0.0, 10.0, 10)) == 1
        assert store.commit([diff(1)], [state("new")]) == 2
        assert by_id(store.spots()) == by_id([state("a"), state("new")])

    def test_spots_are_replaced_as_a_whole(self, store):
        store.commit([diff(0)], [state("a"), state("b")])
        store.replace_spots([state("b", OCCUPIED)])
        assert store.spots() == [state("b", OCCUPIED)]

    def test_history_tells_what_changed_and_when(self, store):
        store.commit([diff(0, 100.0)], [state("a")])
        store.commit([diff(1, 200.0), diff(2, 210.0)], [state("a", OCCUPIED), state("b")])
        store.commit([diff(3, 300.0)], [state("b", OCCUPIED)])
        changes = store.history(0.0, 1e9, 10)
        assert [(c.number, c.received_at, c.state.spot_id) for c in changes] == [
            (1, 100.0, "a"),
            (2, 210.0, "a"),
            (3, 210.0, "b"),
            (4, 300.0, "b"),
        ]
        assert [c.number for c in store.history(150.0, 250.0, 10)] == [2, 3]
        assert [c.number for c in store.history(0.0, 1e9, 2, after=1)] == [2, 3]
        assert changes[0].state == without_evidence([state("a")])[0]
        assert store.history_extent() == (100.0, 300.0)

    def test_spots_as_of_a_time(self, store):
        store.commit([diff(0, 100.0)], [state("a"), state("b")])
        store.commit([diff(1, 200.0)], [state("a", OCCUPIED)])
        assert not store.spots_at(99.0)
        assert by_id(store.spots_at(100.0)) == by_id(without_evidence([state("a"), state("b")]))
        assert by_id(store.spots_at(200.0)) == by_id(without_evidence([state("a", OCCUPIED), state("b")]))

    def test_audit_entries_are_numbered(self, store):
        store.audit(AuditEntry(0, 1.0, "car-1", "refused", "too far away"))
        store.audit(AuditEntry(0, 2.0, "operator", "edited", "spot 7"))
        assert store.audit_entries() == [
            AuditEntry(1, 1.0, "car-1", "refused", "too far away"),
            AuditEntry(2, 2.0, "operator", "edited", "spot 7"),
        ]
        assert [entry.number for entry in store.audit_entries(after=1)] == [2]
        assert [entry.number for entry in store.audit_entries(limit=1)] == [1]

    def test_edits_of_the_parking_map_are_kept_with_what_they_made_of_their_spot(self, store, address):
        store.commit([diff(0)], [state("a"), state("b")])
        assert store.commit_edit(b'{"one": 1}', "operator", "a", state("a", OCCUPIED, 0.5)) == 1
        assert store.commit_edit(b'{"two": 2}', "operator", "b", None) == 2
        assert store.commit_edit(b'{"three": 3}', "operator", "c", state("c", observed_at=None)) == 3
        store.close()
        again = open_store(address)
        assert list(again.spot_edits()) == [b'{"one": 1}', b'{"two": 2}', b'{"three": 3}']
        assert again.spots() == [state("a", OCCUPIED, 0.5)]
        assert [change.state.spot_id for change in again.history(0.0, 1e12, 10)] == ["a", "b", "a", "c"]
        assert again.commit([diff(1)], [state("c")]) == 2
        again.close()

    def test_two_snapshots_are_kept_and_damaged_ones_left_out(self, store):
        large = bytes(range(256)) * 10_000
        store.commit([diff(n) for n in range(5)], [])
        for position, data in ((1, b"one"), (3, large), (5, b"five")):
            store.save_snapshot(position, [data[:5], data[5:]])
        assert list(store.snapshots()) == [(5, b"five"), (3, large)]
        store._side.execute("UPDATE snapshot_parts SET data = ? WHERE position = 5", (b"FIVE",))
        assert list(store.snapshots()) == [(3, large)]

    def test_only_what_snapshots_cover_is_pruned(self, store, address):
        for n in range(6):
            store.commit([diff(n, 100.0 * n)], [state("a", observed_at=100.0 * n)])
            store.audit(AuditEntry(0, 100.0 * n, "car-1", "refused", ""))
        assert store.prune(1e9, 0.0) == 0
        store.save_snapshot(4, [b"four"])
        store.save_snapshot(6, [b"six"])
        assert store.prune(200.0, 300.0) == 2
        assert store.oldest == 3
        assert store.prune(1e9, 300.0) == 2
        assert store.oldest == 5
        assert [accepted.sequence for accepted in store.log(after=4)] == [4, 5]
        assert [change.received_at for change in store.history(0.0, 1e9, 10)] == [300.0, 400.0, 500.0]
        assert [entry.at for entry in store.audit_entries()] == [300.0, 400.0, 500.0]
        store.close()
        again = open_store(address)
        assert (again.position, again.oldest) == (6, 5)
        assert again.commit([diff(6)], [state("a")]) == 7
        assert [change.number for change in again.history(0.0, 1e9, 10)][-1] == 7
        again.close()

    def test_one_process_writes(self, store, address):
        store.commit([diff(0)], [])
        other = open_store(address)
        store.commit([diff(1)], [])
        with pytest.raises(StoreError, match="another process"):
            other.commit([diff(2)], [state("a")])
        other.close()
        assert store.commit([diff(2)], []) == 3

    def test_tokens_lie_in_the_same_database(self, store, address):
        tokens, others = open_tokens(address, clock=lambda: 5.0), open_tokens(address)
        secret = tokens.add("car-1", frozenset({Scope.DIFFS, Scope.OPERATOR}))
        with pytest.raises(StoreError, match="another name"):
            tokens.add("car-1", frozenset({Scope.DIFFS}))
        known = others.find(secret)
        assert (known.name, known.scopes, known.created_at) == ("car-1", {Scope.DIFFS, Scope.OPERATOR}, 5.0)
        assert known.allows(Scope.MAP)
        tokens.revoke("car-1")
        assert tokens.find(secret) is None
        with pytest.raises(StoreError, match="no good token"):
            tokens.revoke("car-1")
        assert [token.revoked_at for token in tokens.all()] == [5.0]
        assert store.commit([diff(0)], []) == 1
        tokens.close()
        others.close()


class TestSqlite(Conformance):
    @pytest.fixture
    def address(self, tmp_path):
        return tmp_path / "cloud.db"


class TestPostgres(Conformance):
    numbers = itertools.count()

    @pytest.fixture
    def address(self, server):
        return server.make(f"cloud_{next(self.numbers)}")

    def test_spots_are_a_layer_for_gis_tools(self, store):
        parking_map = Street(count=3).parking_map
        store.survey(parking_map)
        store.survey(parking_map)
        store.commit([diff(0)], [state("S1")])
        lon_lat = parking_map.georeference.to_lon_lat(parking_map.spots[1].centre[None])[0]
        rows = store._side.execute(
            "SELECT spot_id, state, ST_Area(outline::geography) FROM parking_spots "
            "WHERE ST_Contains(outline, ST_SetSRID(ST_Point(?, ?), 4326))",
            lon_lat.tolist(),
        )
        assert [(spot_id, state) for spot_id, state, _ in rows] == [("S1", "vacant")]
        assert rows[0][2] == pytest.approx(parking_map.spots[1].polygon.area, rel=0.01)
        assert len(store._side.execute("SELECT * FROM parking_spots WHERE state = 'unknown'")) == 2

    def test_a_server_that_is_away_is_named_and_comes_back(self, store, server):
        store.commit([diff(0)], [state("a")])
        server.stop()
        try:
            with pytest.raises(StoreError, match="does not answer"):
                store.commit([diff(1)], [state("b")])
            with pytest.raises(StoreError, match="does not answer"):
                store.spots()
        finally:
            server.start()
        assert store.spots() == [state("a")]
        assert store.commit([diff(1)], [state("b")]) == 2

    def test_errors_keep_the_password_to_themselves(self):
        with pytest.raises(StoreError, match="cars@localhost") as raised:
            open_store("postgresql://cars:opensesame@localhost:1/cloud")
        assert "opensesame" not in str(raised.value)
