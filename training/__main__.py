"""`python -m training`: make the bundled segmentation model, step by step.

Examples:

    python -m training generate --data /tmp/training-data --streets 100
    python -m training train --data /tmp/training-data --run /tmp/run --steps 6000
    python -m training quantise /tmp/run/model.onnx -o /tmp/run/quantised.onnx
    python -m training evaluate --model /tmp/run/quantised.onnx
    python -m training ship /tmp/run/quantised.onnx
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

_DATA = Path("/tmp/training-data")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m training", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)

    generate = commands.add_parser("generate", help="render pictures of random streets")
    generate.add_argument("--data", type=Path, default=_DATA)
    generate.add_argument("--first", type=int, default=0, help="number of the first street")
    generate.add_argument("--streets", type=int, default=100)
    generate.add_argument("--pictures", type=int, default=56, help="of every street")

    train = commands.add_parser("train", help="train, or go on with a run that was cut short")
    train.add_argument("--data", type=Path, default=_DATA)
    train.add_argument("--run", type=Path, required=True, help="folder of checkpoint, log and exported model")
    train.add_argument("--steps", type=int, default=6000, help="batches in all")
    train.add_argument("--minutes", type=float, help="by the clock, in place of --steps")
    train.add_argument("--batch", type=int, default=8)
    train.add_argument("--lr", type=float, default=3e-3, help="highest learning rate")
    train.add_argument("--start-from", type=Path, help="an exported model to begin with, such as the bundled one")
    train.add_argument("--processes", type=int, default=2, help="of one thread each")
    train.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="a GPU takes --processes 1")
    train.add_argument("--workers", type=int, default=1, help="processes that make crops, for each that trains")
    train.add_argument("--hardness", type=float, default=1.0, help="of the samples, 0 to 1")
    train.add_argument("--seed", type=int, default=0)

    quantise = commands.add_parser("quantise", help="make an exported model one of eight-bit integers")
    quantise.add_argument("model", type=Path)
    quantise.add_argument("-o", "--output", type=Path, required=True)
    quantise.add_argument("--data", type=Path, default=_DATA, help="whose crops say what range activations have")

    evaluate = commands.add_parser("evaluate", help="recall, precision, touching pairs and milliseconds")
    evaluate.add_argument("--model", default="bundled", help="an .onnx file; the bundled model by default")
    evaluate.add_argument("--cache", type=Path, default=Path("/tmp/training-evaluation"))
    evaluate.add_argument("--streets", type=int, default=10)
    evaluate.add_argument("--frames", type=int, default=12, help="of every street")
    evaluate.add_argument("--real", type=Path, nargs="*", default=[], help="folders of real drives")
    evaluate.add_argument("--reference", type=Path, help="model whose finds are the truth of the real drives")
    evaluate.add_argument("--min-confidence", type=float)
    evaluate.add_argument("--long-side", type=int, help="pixels of the longer side of the network's input")
    evaluate.add_argument("--threads", type=int, default=2)
    evaluate.add_argument("--json", type=Path, help="also write the figures to this file")

    ship = commands.add_parser("ship", help="put an exported model where the package looks for it")
    ship.add_argument("model", type=Path)
    return parser


def main() -> None:
    """Run the command that the arguments name."""
    args = _parser().parse_args()
    if args.command == "generate":
        from training.generate import generate

        generate(args.data, args.first, args.streets, args.pictures)
    elif args.command == "train":
        from training.train import Plan, train

        train(
            Plan(
                data=args.data,
                run=args.run,
                steps=args.steps,
                batch=args.batch,
                lr=args.lr,
                start_from=args.start_from,
                processes=args.processes,
                hardness=args.hardness,
                seed=args.seed,
                device=args.device,
                workers=args.workers,
                minutes=args.minutes,
            )
        )
    elif args.command == "quantise":
        from training.quantise import quantise

        quantise(args.model, args.output, args.data)
    elif args.command == "evaluate":
        _evaluate(args)
    else:
        from training.ship import ship

        ship(args.model)


def _evaluate(args: argparse.Namespace) -> None:
    from autowaze.vehicle.semantics.segmenter import load_segmenter
    from training.evaluate import evaluate

    model = load_segmenter(
        args.model, min_confidence=args.min_confidence, long_side=args.long_side, threads=args.threads
    )
    results = evaluate(model, args.cache, args.streets, args.frames, args.real, args.reference)
    for name, metrics in results.items():
        print(f"{name:22s}", "  ".join(f"{metric} {value:.3f}" for metric, value in metrics.items()))
    if args.json:
        args.json.write_text(json.dumps({"model": str(args.model), "results": results}, indent=1))


if __name__ == "__main__":
    main()
