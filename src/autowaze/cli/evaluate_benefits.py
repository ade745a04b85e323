"""`autowaze evaluate benefits`: what drivers gain who know where a spot is free."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from autowaze.cli.options import JsonFile, console, print_metrics
from autowaze.evaluation.benefits.costs import Rates
from autowaze.evaluation.benefits.picture import draw_benefits
from autowaze.evaluation.benefits.places import PlaceKind
from autowaze.evaluation.benefits.study import THESIS_FIGURES, drawn_searches, search_places, thesis_metrics
from autowaze.evaluation.benefits.thesis_lot import thesis_lot
from autowaze.evaluation.report import report, write_report
from autowaze.world.errors import AutowazeError

_SHOWN = ("without_mean_m", "without_p95_m", "with_mean_m", "with_p95_m", "saved_mean_s", "saved_mean_usd")
_SHOWN_SHARE = ("saved_fraction", "saved_low", "saved_high")


def benefits(
    occupancy: Annotated[
        list[float] | None, typer.Option(help="Share of spots taken; may be given more than once; 1 leaves one free.")
    ] = None,
    places: Annotated[int, typer.Option(help="Places drawn of each kind.", min=2, max=10_000)] = 40,
    searches: Annotated[int, typer.Option(help="Searches in each place at each occupancy.", min=1, max=10_000)] = 25,
    seed: Annotated[int, typer.Option(help="Of everything drawn.", min=0)] = 0,
    speed_mph: Annotated[float, typer.Option(help="How fast one searches, miles per hour.", min=1.0)] = 10.0,
    mileage_mpg: Annotated[float, typer.Option(help="Miles per US gallon.", min=1.0)] = 25.0,
    price_usd: Annotated[float, typer.Option(help="Price of a gallon, dollars.", min=0.0)] = 3.50,
    plot: Annotated[Path | None, typer.Option(help="Draw both ways and the distributions into this picture.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Search distance, time, fuel and cost with and without Autowaze (thesis, sec. 4.4).

    On the thesis's car park of 80 m x 30 m, and as a distribution over streets, blocks, districts and car parks. Who
    has Autowaze drives to the nearest vacant spot; who has not searches lane by lane until a vacant spot is passed.

    Example:

        autowaze evaluate benefits --occupancy 0.9 --occupancy 1 --plot benefits.png --json benefits.json
    """
    occupancies = occupancy or [0.7, 0.85, 0.95, 1.0]
    if not all(0.0 <= share <= 1.0 for share in occupancies):
        raise AutowazeError(f"--occupancy {', '.join(map(str, occupancies))}: a share lies between 0 and 1")
    rates, rng, lot = Rates(speed_mph, mileage_mpg, price_usd), np.random.default_rng(seed), thesis_lot()
    on_lot = thesis_metrics(lot, rates)
    print_metrics("thesis's car park, the spot found last", {"from the lanes": on_lot, "thesis": THESIS_FIGURES})
    results = {
        "thesis lot, unluckiest": on_lot,
        "thesis lot, drawn": drawn_searches(lot, places * searches, seed).metrics(rates, rng),
    }
    lengths = {}
    for kind in PlaceKind:
        for share, found in search_places(kind, occupancies, places, searches, seed).items():
            lengths[kind, share] = found
            results[f"{kind} {share:.2f}"] = found.metrics(rates, rng)
    distributions = {name: metrics for name, metrics in results.items() if name != "thesis lot, unluckiest"}
    shown = {name: {key: m[key] for key in (*_SHOWN, *_SHOWN_SHARE)} for name, m in distributions.items()}
    print_metrics("searches by place and share of spots taken; saved_low to saved_high: 95 % of the saved share", shown)
    if plot:
        draw_benefits(plot, lot, lengths)
        console.print(f"drawn in {plot}")
    if json_file:
        inputs = {"occupancies": occupancies, "places": places, "searches": searches, "seed": seed, **vars(rates)}
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
