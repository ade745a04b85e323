"""What a listener hears, and what one that comes back is told."""

import asyncio

import numpy as np
import pytest

from autowaze.cloud.api.changes import KEPT_EVENTS, ChangeFeed
from autowaze.cloud.api.listeners import MOST_UNREAD, Listeners
from autowaze.cloud.api.problems import ProblemError
from autowaze.cloud.broadcast import Update
from autowaze.world.feature_map import MapFeatures
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import Occupancy, SpotState


def update(version):
    state = SpotState(f"S{version}", Occupancy.VACANT, 0.9, 1000.0)
    nothing = MapUpdate(version - 1, version, MapFeatures.empty(), np.zeros(0, np.uint64))
    return Update(True, version, (state,), [], nothing)


def heard(feed, since, count):
    """The first events of a listener that comes back."""

    async def listen():
        events = []
        listening = feed.listen(since)
        while len(events) < count:
            events.append(await anext(listening))
        await listening.aclose()
        return [(event.kind, event.version) for event in events]

    return asyncio.run(listen())


def test_who_comes_back_hears_what_was_missed():
    feed = ChangeFeed(0)
    for version in range(1, 6):
        feed.publish(update(version))
    assert heard(feed, 3, 2) == [("spots", 4), ("spots", 5)]
    assert heard(feed, 5, 1) == [("current", 5)]
    assert heard(feed, None, 1) == [("current", 5)]
    assert heard(feed, 6, 1) == [("reset", 5)]


def test_a_parking_map_drawn_between_versions_is_not_missed():
    feed = ChangeFeed(0)
    feed.publish(update(1))
    feed.announce_parking_map(8)
    assert heard(feed, 1, 1) == [("parking_map", 1)]  # whoever has version 1 may have left before the map was drawn
    feed.publish(update(2))
    assert heard(feed, 0, 3) == [("spots", 1), ("parking_map", 1), ("spots", 2)]
    assert heard(feed, 2, 1) == [("current", 2)]


def test_who_was_away_too_long_starts_anew():
    feed = ChangeFeed(0)
    for version in range(1, KEPT_EVENTS + 3):
        feed.publish(update(version))
    assert heard(feed, 1, 1) == [("reset", KEPT_EVENTS + 2)]
    assert heard(feed, 2, 1) == [("spots", 3)]


def test_a_version_of_which_nobody_was_told_makes_listeners_start_anew():
    feed = ChangeFeed(0)
    feed.publish(update(1))

    async def listen():
        listening = feed.listen(1)
        assert (await anext(listening)).kind == "current"
        feed.publish(update(3))  # the commit of 2 was kept, though no answer came
        event = await anext(listening)
        assert (event.kind, event.version) == ("reset", 3)
        feed.publish(update(4))
        assert (await anext(listening)).kind == "spots"
        await listening.aclose()

    asyncio.run(listen())
    assert heard(feed, 1, 1) == [("reset", 4)]
    assert heard(feed, 3, 1) == [("spots", 4)]


def test_one_address_cannot_take_the_place_of_all_listeners():
    async def listen():
        listeners = Listeners(most=4, per_address=2)
        crowd = [listeners.listen(lambda: ["first"], "192.0.2.1") for _ in range(2)]
        for listening in crowd:
            await anext(listening)
        assert not listeners.has_room("192.0.2.1")
        with pytest.raises(ProblemError, match="too many listen"):
            listeners.require_room("192.0.2.1")
        assert listeners.has_room("192.0.2.2")
        near = [listeners.listen(lambda: ["first"], "127.0.0.1") for _ in range(2)]
        for listening in near:
            await anext(listening)
        assert not listeners.has_room("192.0.2.2")
        await crowd[0].aclose()
        assert listeners.has_room("192.0.2.1")
        for listening in [crowd[1], *near]:
            await listening.aclose()

    asyncio.run(listen())


def test_a_listener_that_does_not_read_is_let_go_and_the_others_hear_on():
    feed = ChangeFeed(0)

    async def listen():
        slow, quick = feed.listen(None), feed.listen(None)
        assert [(await anext(slow)).kind, (await anext(quick)).kind] == ["current", "current"]
        for version in range(1, MOST_UNREAD + 2):
            feed.publish(update(version))
            assert (await anext(quick)).version == version
        assert [event async for event in slow] == []
        assert len(feed.listeners) == 1
        feed.listeners.close()
        assert [event async for event in quick] == []
        assert [event async for event in feed.listen(None)] == []

    asyncio.run(listen())
