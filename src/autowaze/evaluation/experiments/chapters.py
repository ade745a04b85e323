"""The report's sections about experiments: what was found, as tables, pictures and text."""

from __future__ import annotations

from collections.abc import Mapping

from autowaze.evaluation.experiments import printed
from autowaze.evaluation.experiments.confusion_pictures import draw_confusions, worst_confusions
from autowaze.evaluation.experiments.figures import draw_calibration, draw_offsets, draw_scores
from autowaze.evaluation.experiments.findings import (
    Findings,
    driving_metrics,
    sent_metrics,
    unchanged_bytes_per_km,
)
from autowaze.evaluation.experiments.scores import Scores, calibrate
from autowaze.evaluation.experiments.variants import ABLATIONS, METHODS, OFFSETS, OFFSETS_M
from autowaze.evaluation.network import CONTENTS
from autowaze.evaluation.reporting.document import Block, Picture, Section, Table, Text

_BELIEFS = ("fused",)


def spots_section(found: Findings) -> Section:
    """Methods side by side, with the thesis's figures."""
    scores, thesis = found.scores(METHODS), printed.METHODS.get(found.name, {})
    driven = driving_metrics(found.series)
    first = next(iter(scores.values()))
    words = (
        f"{found.drives} of {found.planned} drives; {first.spots} times a drive had a spot in sight, "
        f"{first.vacant} of them vacant. Vacant is positive; a spot in sight without an answer is an error. In "
        "brackets 95 %, by bootstrap over drives."
    )
    if "position_error_median_cm" in driven:
        words += (
            f" The cars were {driven['position_error_median_cm']:.0f} cm off in the median "
            f"({driven['position_error_p95_cm']:.0f} cm at the 95th percentile)."
        )
    blocks: list[Block] = [
        Text(words),
        _method_table(scores, thesis),
        Picture(f"scores-{found.name}", draw_scores(scores, thesis), f"{found.title}: scores by method"),
        Text("What lies behind the figures, and how well vehicles were placed."),
        _box_table(scores),
    ]
    streets = found.by_street("fused")
    if len(streets) > 1:
        blocks += [Text("`fused` street by street."), _method_table(streets, {})]
    return Section(found.title, blocks)


def calibration_section(found: Mapping[str, Findings]) -> Section:
    """Stated probabilities against what came true."""
    calibrations = {
        f"{one.title}, {name}": calibrate(one.verdicts(name)) for one in found.values() for name in _BELIEFS
    }
    words = "A spot that is called vacant with a probability of 0.8 should be vacant in four of five cases."
    picture = Picture("calibration", draw_calibration(calibrations), "Reliability of the stated probabilities")
    rows = tuple((name, f"{c.error:.3f}", f"{c.brier:.3f}") for name, c in calibrations.items())
    table = Table(("experiment", "expected calibration error", "Brier score"), rows)
    return Section("Calibration", [Text(words), picture, table])


def ablation_section(found: Findings) -> Section:
    """What each part brings."""
    scores = found.scores(ABLATIONS)
    words = (
        "The same diffs, one part of the service left out or replaced at a time. `DBSCAN for instance ids` groups "
        "vehicle points by density, as the baselines do."
    )
    strong = frozenset(row for row, name in enumerate(scores) if "," not in name)
    return Section(f"What each part brings: {found.title}", [Text(words), _score_table(scores, strong)])


def offset_section(found: Findings) -> Section:
    """How accuracy falls when cars are off."""
    scores = found.scores((*METHODS, *OFFSETS))
    steps = (0.0, *OFFSETS_M)
    accuracy = {
        name: [scores[name if not metres else f"{name}, {metres:g} m off"].accuracy.value for metres in steps]
        for name in ("thesis", "fused")
    }
    rows = tuple((name, *(f"{value:.3f}" for value in values)) for name, values in accuracy.items())
    words = "Each drive is displaced by so much in a direction of its own, and does not know it. Accuracy:"
    table = Table(("method", *(f"{metres:g} m" for metres in steps)), rows)
    picture = Picture(f"offsets-{found.name}", draw_offsets(steps, accuracy), "Accuracy by displacement")
    return Section(f"A position that is off: {found.title}", [Text(words), table, picture])


def confusion_section(found: Findings) -> Section:
    """Pictures of the worst mistakes of both our methods."""
    series = {name: one for one in found.series for name in one.names}
    blocks: list[Block] = []
    for variant in METHODS[-2:]:
        worst = worst_confusions(found.verdicts(variant.name))
        wrong = sum(v.counts and not v.is_right for v in found.verdicts(variant.name))
        blocks.append(Text(f"`{variant.name}`: {wrong} wrong answers" + (", the surest of them:" if worst else ".")))
        if worst:
            says = (
                f"{found.title}, {variant.name}: map points grey, vehicle points and boxes blue, true vehicles dotted, "
                "the path pink; spots are coloured as they were called: green vacant, red occupied, grey unknown"
            )
            name = f"confusions-{found.name}-{variant.name}"
            blocks.append(Picture(name, draw_confusions(worst, series, variant), says))
    return Section(f"Worst confusions: {found.title}", blocks)


def network_section(found: Mapping[str, Findings]) -> Section:
    """What cars sent."""
    sent = {one.title: sent_metrics(one.series) for one in found.values()}
    low, high = printed.DIFF_BYTES
    rows = []
    for label, key in (
        ("diff, median", "diff_bytes_median"),
        ("diff, 95th percentile", "diff_bytes_p95"),
        ("diff, largest", "diff_bytes_max"),
        *((f"of a diff on average: {name}", f"{name}_bytes_per_diff") for name in CONTENTS),
        ("diffs per km", "bytes_per_km"),
        ("whole map instead (`orb-slam2`), median", "full_map_bytes_median"),
        ("whole map instead, per km", "full_map_bytes_per_km"),
    ):
        thesis = f"{low:,} to {high:,}" if key == "diff_bytes_median" else ""
        rows.append((label, *(f"{metrics[key]:,.0f}" for metrics in sent.values()), thesis))
    words = (
        "Bytes up per window of 5 s at the service's map, other cars parked in every drive. `autowaze evaluate "
        "network` measures the way down."
    )
    blocks: list[Block] = [Text(words), Table(("bytes", *sent, "thesis, sec. 4.5"), tuple(rows))]
    unchanged = [row for one in found.values() for row in _unchanged_rows(one)]
    if unchanged:
        blocks.append(Text("Another drive past the very cars of the survey, with its map: nothing has changed."))
        blocks.append(Table(("street", "windows, bytes", "KB per km"), tuple(unchanged)))
    return Section("Network", blocks)


def _unchanged_rows(found: Findings) -> list[tuple[str, str, str]]:
    per_km = unchanged_bytes_per_km(found.series)
    return [
        (one.street, ", ".join(f"{len(m):,}" for m in one.unchanged.messages), f"{per_km[one.street] / 1000:.1f}")
        for one in found.series
        if one.unchanged is not None
    ]


def _method_table(scores: Mapping[str, Scores], thesis: Mapping[str, tuple[float, float, float]]) -> Table:
    rows = []
    for name, s in scores.items():
        printed_here = thesis.get(name)
        beside = " / ".join(f"{value:.2f}" for value in printed_here) if printed_here else ""
        rows.append((name, str(s.precision), str(s.recall), str(s.accuracy), beside))
    strong = frozenset(row for row, name in enumerate(scores) if name == "fused")
    headings = ("method", "precision", "recall", "accuracy", "thesis: precision / recall / accuracy")
    if not thesis:
        return Table(headings[:-1], tuple(row[:-1] for row in rows), strong)
    return Table(headings, tuple(rows), strong)


def _score_table(scores: Mapping[str, Scores], strong: frozenset[int]) -> Table:
    rows = tuple(
        (
            name,
            str(s.precision),
            str(s.recall),
            str(s.accuracy),
            f"{s.false_vacant}",
            f"{s.false_occupied}",
            f"{s.unknown}",
        )
        for name, s in scores.items()
    )
    headings = ("variant", "precision", "recall", "accuracy", "false vacant", "false occupied", "unknown")
    return Table(headings, rows, strong)


def _box_table(scores: Mapping[str, Scores]) -> Table:
    rows = tuple(
        (
            name,
            f"{s.false_vacant}",
            f"{s.false_occupied}",
            f"{s.unknown}",
            f"{s.unseen_vacant}",
            f"{s.own_car:.3f}",
            f"{s.centre_median_m:.2f} / {s.centre_p95_m:.2f} m",
            f"{s.heading_median_deg:.1f} / {s.heading_p95_deg:.1f}°",
        )
        for name, s in scores.items()
    )
    headings = (
        "method",
        "occupied called vacant",
        "vacant called occupied",
        "no answer",
        "never in view, called vacant",
        "marked by their own car",
        "centre off, median / p95",
        "heading off, median / p95",
    )
    return Table(headings, rows, frozenset(row for row, name in enumerate(scores) if name == "fused"))
