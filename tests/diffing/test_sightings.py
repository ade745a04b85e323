"""Compiled sums over sightings agree with sums by hand."""

from collections import Counter

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from autowaze.vehicle.diffing.sightings import by_landmark, position_sigmas, summed_up

LANDMARKS, FRAMES = 7, 5
sightings = st.lists(
    st.tuples(
        st.integers(-1, LANDMARKS - 1), st.integers(0, FRAMES - 1), st.integers(0, 3), st.sampled_from([4.0, 5.0])
    ),
    max_size=40,
)


@settings(max_examples=50)
@given(sightings, st.lists(st.booleans(), min_size=LANDMARKS, max_size=LANDMARKS))
def test_each_landmark_gets_what_its_sightings_say(seen: list[tuple[int, int, int, float]], asked: list[bool]) -> None:
    table = np.array(seen, np.float64).reshape(-1, 4)
    row, frame, kind = table[:, :3].astype(np.int64).T.copy()
    thin = np.arange(FRAMES) % 2 == 0
    rows, starts, order = by_landmark(row, np.array(asked))
    kinds, found, wanted, nearest = summed_up(starts, order, frame, kind, table[:, 3].copy(), thin)
    assert rows.tolist() == sorted({r for r, *_ in seen if r >= 0 and asked[r]})
    for n, landmark in enumerate(rows.tolist()):
        own = [i for i, (r, *_) in enumerate(seen) if r == landmark]
        assert order[starts[n] : starts[n + 1]].tolist() == own
        votes = Counter(seen[i][2] for i in own)
        assert kinds[n] == min(v for v in votes if votes[v] == max(votes.values()))
        assert found[n] == len(own)
        assert wanted[n] == sum(seen[i][1] % 2 == 0 for i in own)
        assert nearest[n] == min(own, key=lambda i: seen[i][3])


def test_a_place_is_as_sure_as_the_information_of_its_views() -> None:
    rng = np.random.default_rng(0)
    centre, position = rng.uniform(-1, 1, (4, 3)), rng.uniform(3, 30, (20, 3))
    depth_sigma = rng.uniform(0.02, 3.0, 20)
    starts, order = np.arange(0, 81, 4), np.arange(80)
    sigma = position_sigmas(starts, order, order % 4, centre, position, depth_sigma, np.arange(20) > 0, 700.0)
    assert np.isinf(sigma[0])
    for place, sigma_m, told in zip(position[1:], depth_sigma[1:], sigma[1:], strict=True):
        rays = place - centre
        distance = np.linalg.norm(rays, axis=1)
        units = rays / distance[:, None]
        information = sum((700.0 / d) ** 2 * (np.eye(3) - np.outer(u, u)) for u, d in zip(units, distance, strict=True))
        nearest = units[distance.argmin()]
        information = information + np.outer(nearest, nearest) / sigma_m**2
        assert np.isclose(told, np.linalg.eigvalsh(information)[0] ** -0.5, rtol=1e-6)
