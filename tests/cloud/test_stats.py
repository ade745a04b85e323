"""The figures of the live map's panel."""

import numpy as np
import pytest

from autowaze.cloud.api.meters import Meters
from autowaze.cloud.api.spot_book import FadingStates
from autowaze.cloud.belief import aged, fade, faded_probability
from autowaze.world.parking import Occupancy, SpotState


def test_the_panel_says_what_was_taken_in_and_what_is_believed(site, payloads):
    before = site.client.get("/stats").json()
    assert before["diffs"] == {"total": 0, "per_second": 0.0, "bytes_total": 0}
    assert before["delay_ms"] == {"p50": None, "p99": None}
    assert before["spots"] == {"vacant": 0, "occupied": 0, "unknown": 12}
    for payload in [*payloads, payloads[0]]:
        site.hand_in(payload)
    panel_lives_for_a_second(site)
    after = site.client.get("/stats").json()
    assert after["diffs"]["total"] == len(payloads) + 1
    assert after["diffs"]["bytes_total"] == sum(map(len, [*payloads, payloads[0]]))
    assert after["diffs"]["per_second"] > 0
    assert after["map_version"] == len(payloads)
    assert after["map_features"] == len(site.durable.service.map.features) > 0
    assert 0 < after["delay_ms"]["p50"] <= after["delay_ms"]["p99"]
    assert after["stages_ms"]["integration"] > 0
    shown = [f["properties"]["state"] for f in site.client.get("/spots.geojson").json()["features"]]
    assert after["spots"] == {state: shown.count(state) for state in ("vacant", "occupied", "unknown")}


def panel_lives_for_a_second(site):
    import time

    from autowaze.cloud.api.stats import FRESH_S

    time.sleep(FRESH_S)


def test_the_rate_is_that_of_the_last_minute():
    now = [100.0]
    meters = Meters(clock=lambda: now[0])
    for second in range(100, 220):
        now[0] = float(second)
        meters.taken_in(True, 1000, 0.010)
        meters.taken_in(False, 1000, 0.020)
    recent = meters.recent(220.0)
    assert recent.per_second == pytest.approx(2.0, abs=0.05)
    assert np.median(recent.delays_ms) == pytest.approx(15.0)
    assert meters.recent(400.0).per_second == 0.0


def test_probabilities_fade_as_states_do():
    states = [SpotState("A", Occupancy.VACANT, 0.97, 900.0), SpotState("B", Occupancy.OCCUPIED, 0.1, 100.0)]
    states.append(SpotState("C", Occupancy.UNKNOWN))
    fading = FadingStates(states, 4000.0, fades=True)
    rows = np.arange(3)
    expected = [aged(state, 4000.0).probability_vacant for state in states]
    assert fading.probabilities(rows) == pytest.approx(expected)
    assert [state.probability_vacant for state in fading] == pytest.approx(expected)
    later = [aged(state, 4900.0).probability_vacant for state in states]
    assert fading.probabilities(rows, 900.0) == pytest.approx(later)
    log_odds = fade(np.log(0.1 / 0.9), 1234.0)
    assert faded_probability(np.array([0.9]), np.array([1234.0])) == pytest.approx(1 / (1 + np.exp(log_odds)))
    assert fading.counts() == {kind: [s.occupancy for s in fading].count(kind) for kind in Occupancy}


def test_states_of_methods_without_belief_stay():
    states = [SpotState("A", Occupancy.VACANT, 1.0, 900.0), SpotState("B", Occupancy.OCCUPIED, 0.0, 100.0)]
    staying = FadingStates(states, 1e6, fades=False)
    assert list(staying) == states
    assert staying.probabilities(np.arange(2)).tolist() == [1.0, 0.0]
    assert staying.counts()[Occupancy.VACANT] == 1
