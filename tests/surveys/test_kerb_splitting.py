"""Kerbs and areas cut into spots: whatever is asked, they lie apart, inside, and are of a size."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from autowaze.world.spot_check import faults_of_shape, overlaps
from autowaze.world.surveys.kerb_rules import kerb_rule, metres, whole_number
from autowaze.world.surveys.kerb_spots import (
    SLACK,
    TIGHTEST,
    area_into_spots,
    free_stretches,
    pitch,
    row_of_spots,
    spots_per_stretch,
)

KINDS = st.sampled_from(["parallel", "perpendicular", "angled"])
GAPS = st.lists(st.tuples(st.floats(-20, 320), st.floats(0, 40)).map(lambda g: (g[0], g[0] + g[1])), max_size=8)


@given(st.floats(1, 300), GAPS)
def test_free_stretches_and_gaps_make_up_the_kerb(length, gaps):
    free = free_stretches(length, gaps)
    assert all(0 <= a < b <= length for a, b in free)
    assert all(one[1] <= other[0] for one, other in pairwise(free))
    for s in np.linspace(0, length, 200):
        in_gap = any(a < s < b for a, b in gaps)
        is_free = any(a < s < b for a, b in free)
        on_edge = any(min(abs(s - a), abs(s - b)) < 1e-6 for a, b in [*free, *gaps])
        assert on_edge or s in (0.0, length) or in_gap != is_free


@given(st.lists(st.floats(0.5, 120), min_size=1, max_size=6), KINDS, st.none() | st.integers(1, 200))
def test_no_stretch_takes_more_spots_than_fit(lengths, kind, capacity):
    stretches = [(200.0 * i, 200.0 * i + length) for i, length in enumerate(lengths)]
    counts, step = spots_per_stretch(stretches, kind, capacity)
    assert TIGHTEST * pitch(kind) * 0.98 <= step <= pitch(kind)
    assert all(0 <= n * step <= length + (SLACK + 1e-6) * step for n, length in zip(counts, lengths, strict=True))
    usual, _ = spots_per_stretch(stretches, kind, None)
    if capacity is not None and capacity <= sum(usual):
        assert sum(counts) == capacity
    elif capacity is not None:
        assert sum(usual) <= sum(counts) <= max(capacity, sum(usual))


@settings(max_examples=60)
@given(
    st.floats(15, 200),
    st.floats(-1.0, 1.0),
    KINDS,
    st.sampled_from([-1, 1, -2, 2]),
    st.floats(0, 2 * np.pi),
)
def test_spots_along_a_kerb_lie_apart_on_it_and_in_a_row(length, turn, kind, slant, heading):
    s = np.linspace(0, length, 40)
    angle = heading + turn * s / length * min(length / 40.0, 1.0)
    steps = np.diff(s)[:, None] * np.stack([np.cos(angle[:-1]), np.sin(angle[:-1])], 1)
    line = shapely.LineString(np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]))
    (count,), step = spots_per_stretch([(0.0, line.length)], kind, None)
    outlines = [shapely.Polygon(ring) for ring in row_of_spots(line, (0.0, line.length), count, step, kind, slant)]
    assert len(outlines) == count
    assert not [fault for outline in outlines for fault in faults_of_shape(outline)]
    assert not overlaps(np.array(outlines, dtype=np.object_))
    along = [line.project(outline.centroid) for outline in outlines]
    assert np.allclose(np.diff(along), step, rtol=0.02)
    assert all(line.distance(outline.centroid) < 0.05 for outline in outlines)


@settings(max_examples=60)
@given(st.integers(1, 30), st.sampled_from(["parallel", "perpendicular"]), st.floats(0, 2 * np.pi), st.booleans())
def test_an_area_is_cut_into_as_many_spots_as_it_was_drawn_for(count, kind, heading, has_street):
    wide = 2.0 if kind == "parallel" else 5.0
    area = shapely.box(0.0, 3.0, count * pitch(kind), 3.0 + wide)
    street = shapely.LineString([(-50.0, 0.0), (200.0, 0.0)])
    area, street = (shapely.affinity.rotate(shape, heading, (0, 0), use_radians=True) for shape in (area, street))
    if not has_street and count * pitch(kind) <= wide * 1.05:
        return  # nothing tells which side of so short an area lies along the kerb
    cells, found = area_into_spots(area, street if has_street else None, kind, None)
    assert found == kind
    assert len(cells) == count
    assert shapely.union_all(cells).symmetric_difference(area).area < 0.01 * area.area
    assert not overlaps(np.array(cells, dtype=np.object_))


def test_an_area_round_a_bend_is_cut_along_the_street():
    street = shapely.LineString([(30 * np.sin(a), -30 * np.cos(a)) for a in np.linspace(0, np.pi / 2, 60)])
    bend = np.linspace(0.1, np.pi / 2 - 0.1, 60)
    arcs = [[(r * np.sin(a), -r * np.cos(a)) for a in order] for r, order in ((34, bend), (39, bend[::-1]))]
    cells, kind = area_into_spots(shapely.Polygon([*arcs[0], *arcs[1]]), street, "perpendicular", 18)
    assert (len(cells), kind) == (18, "perpendicular")
    assert not overlaps(np.array(cells, dtype=np.object_))
    assert max(cell.area for cell in cells) < 1.2 * min(cell.area for cell in cells)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5.5", 5.5),
        ("5,5 m", 5.5),
        ("18'", 5.4864),
        ("1e9", None),
        ("-3", None),
        ("", None),
        (None, None),
        ("wide", None),
    ],
)
def test_lengths_as_people_write_them(text, value):
    assert metres(text) == (value if value is None else pytest.approx(value))


@given(st.dictionaries(st.sampled_from([
    "parking:left", "parking:both", "parking:right:orientation", "parking:both:restriction", "parking:lane:left",
    "parking:lane:both", "parking:condition:right", "parking:lane:left:parallel", "parking:left:capacity",
]), st.text(max_size=12)))  # fmt: skip
def test_whatever_the_tags_say_nothing_breaks(tags):
    for side in ("left", "right"):
        kerb_rule(tags, side)
    assert whole_number(tags.get("parking:left:capacity")) is None or int(tags["parking:left:capacity"]) > 0
