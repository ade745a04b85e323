"""Whatever a car sends, the service answers 4xx or takes it in, and goes on."""

import gc
import random

from street import Street

from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import open_store
from autowaze.world import wire_pb2 as pb
from autowaze.world.wire import body_of, decode_diff, encode_diff

COUNT = 1500


def damaged(payload, rng):
    """The diff with its message hurt inside a sound envelope, or the envelope itself hurt."""
    import zstandard

    inside = rng.random() < 0.7
    hurt = bytearray(body_of(payload) if inside else payload)
    for _ in range(rng.randint(1, 6)):
        start = rng.randrange(len(hurt))
        if rng.random() < 0.6:
            hurt[start] = rng.randrange(256)
        elif rng.random() < 0.5:
            del hurt[start : start + rng.randint(1, 30)]
        else:
            hurt[start:start] = hurt[start : start + rng.randint(1, 30)]
    if not inside:
        return bytes(hurt)
    return pb.Envelope(version=1, body=zstandard.compress(bytes(hurt))).SerializeToString()


def test_mutated_diffs_are_answered_and_do_no_harm(site, payloads, diffs):
    rng = random.Random(0)
    statuses = set()
    for number in range(COUNT):
        response = site.hand_in(damaged(payloads[number % len(payloads)], rng))
        statuses.add(response.status_code)
        assert response.status_code in (200, 202, 400, 413, 422), response.text
    assert 400 in statuses
    assert site.client.get("/ready").status_code == 200
    sound = encode_diff(decode_diff(payloads[0]))
    assert site.hand_in(sound).status_code in (200, 202, 422)  # its number may be taken by a mutant
    assert len(site.client.get("/spots.geojson").json()["features"]) == len(site.street.parking_map)


def test_what_is_refused_leaves_no_cycles_in_memory(tmp_path):
    """Old objects are searched for cycles once an hour; a client that sends nonsense must not fill memory till then."""
    parking_map = Street(count=2).parking_map
    durable = DurableService(lambda: CloudService(parking_map), open_store(str(tmp_path / "cloud.db")))
    durable.receive_many([b"nonsense"])
    gc.collect()
    gc.disable()
    try:
        durable.receive_many([b"nonsense"] * 20)
        assert gc.collect() < 20
    finally:
        gc.enable()
        durable.store.close()
