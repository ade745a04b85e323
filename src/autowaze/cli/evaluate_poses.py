"""`autowaze evaluate odometry` and `autowaze evaluate localization`: poses against true ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from autowaze.cli.options import (
    Cameras,
    Frames,
    JsonFile,
    Model,
    Spots,
    console,
    opened,
    parking_map,
    print_metrics,
    segmenter,
    show_progress,
)
from autowaze.evaluation.datum import Start, starting_point, true_poses
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.localization import localization_errors, removal_metrics
from autowaze.evaluation.network import network_metrics
from autowaze.evaluation.odometry import odometry_metrics, run_odometry
from autowaze.evaluation.pose_pictures import Estimate, draw_localization, draw_odometry
from autowaze.evaluation.report import report, write_report
from autowaze.evaluation.restarts import restart_along
from autowaze.evaluation.trajectory import trajectory_metrics
from autowaze.evaluation.trajectory_file import TrajectoryFile, read_trajectory, write_tum
from autowaze.vehicle.diffing.removal import LookedFor
from autowaze.vehicle.node import VehicleNode
from autowaze.world.errors import AutowazeError
from autowaze.world.map_file import load_map

_Trajectory = Annotated[
    Path | None, typer.Option("--trajectory", help="Write the poses here in TUM format, as evo reads them.")
]
_Plot = Annotated[Path | None, typer.Option(help="Draw the path over the truth and its errors into this picture.")]
Results = dict[str, dict[str, float]]


def odometry(
    traces: Annotated[
        list[Path], typer.Argument(help="Folders of stereo drives with ground truth.", show_default=False)
    ],
    cameras: Cameras = "auto",
    frames: Frames = "",
    against: Annotated[
        list[Path] | None,
        typer.Option(help="Another system's poses of the same drive, TUM or KITTI; may be given more than once."),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(help="Write the poses as known after the drive here, in TUM format, as evo reads them."),
    ] = None,
    told: Annotated[
        Path | None, typer.Option(help="Write the poses as they were told when each frame came here, likewise.")
    ] = None,
    plot: _Plot = None,
    json_file: JsonFile = None,
) -> None:
    """Visual odometry against true poses: RPE per frame, APE after alignment, times.

    Scored is the trajectory as known after the drive, loops closed and places adjusted together, as other systems write
    theirs; beside it, as "told", the poses as they were given out when each frame came, which diffs are made with.

    Examples:

        autowaze evaluate odometry kitti/odometry_00 kitti/drive_0005 --json odometry.json

        autowaze evaluate odometry kitti/odometry_00 --against orb_slam2.txt --plot both.png --trajectory ours.tum
    """
    if len(traces) > 1 and (against or trajectory or told or plot):
        raise AutowazeError(f"--against, --trajectory, --told and --plot are for one drive, not for {len(traces)}")
    others = [read_trajectory(path) for path in against or []]
    results: Results = {}
    for path in traces:
        trace = opened(path, cameras, frames)
        T_true = true_poses(trace, None)
        run = run_odometry(trace, show_progress)
        estimates = {"autowaze" if others else trace.name: Estimate(run.timestamp, run.T_adjusted, T_true)}
        estimates |= _of_others(others, run.timestamp, T_true)
        own, *foreign = estimates
        results[own] = odometry_metrics(run, T_true)
        results |= {name: trajectory_metrics(estimates[name].T_world_cam, estimates[name].T_truth) for name in foreign}
        if trajectory:
            write_tum(trajectory, run.timestamp, run.T_adjusted)
        if told:
            write_tum(told, run.timestamp, run.T_map_cam)
        if plot:
            draw_odometry(plot, trace.name, estimates)
    inputs = {"traces": [str(p) for p in traces], "frames": frames, "against": [str(p) for p in against or []]}
    _deliver("odometry", inputs, results, json_file)
    console.print("rpe, ape: as known after the drive, as ORB-SLAM2 writes its trajectory; told: when each frame came")


def localization(
    trace: Annotated[Path, typer.Argument(help="Folder of a stereo drive with ground truth.", show_default=False)],
    stored_map: Annotated[Path, typer.Option("--map", help="Stored map to localise in.")],
    spots: Spots = None,
    model: Model = None,
    cameras: Cameras = "auto",
    frames: Frames = "",
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.GNSS,
    restart_every: Annotated[
        int, typer.Option(min=0, help="Also switch the car on at every n-th frame and see how soon it is localised.")
    ] = 0,
    prior_sigma_m: Annotated[
        float, typer.Option("--prior-sigma", min=0.0, max=50.0, help="Error of what it knows of its place then, m.")
    ] = 3.0,
    trajectory: _Trajectory = None,
    plot: _Plot = None,
    json_file: JsonFile = None,
) -> None:
    """Localisation in a stored map against true poses, and what the diffs say of a map that did not change.

    Example: base map from one pair of a rig, localise the other in it.

        autowaze map kitti/drive_0005 --cameras grey --frames 110:154 --start first-true-pose -o grey.map

        autowaze evaluate localization kitti/drive_0005 --cameras colour --frames 110:154 --map grey.map

    Another day in the same street, the car switched on at every fifth frame.

        autowaze evaluate localization tuesday --map monday.map --restart-every 5 --prior-sigma 3
    """
    source, parking = opened(trace, cameras, frames), parking_map(spots)
    base_map = load_map(stored_map)
    told = starting_point(source, parking, start)
    node = VehicleNode(source.camera, segmenter(model), stored_map=base_map, start=told)
    looked_for: list[LookedFor] = []
    record = run_drive(source, node, lambda message: looked_for.append(node.window.looked_for), show_progress)
    T_true = true_poses(source, parking)
    errors = localization_errors(record.tracked, T_true).metrics()
    metrics = {**errors, **removal_metrics(record.diffs, looked_for), **network_metrics(record)}
    if restart_every:
        metrics |= restart_along(source, T_true, base_map, restart_every, prior_sigma_m).metrics()
    if trajectory:
        write_tum(trajectory, np.array([t.timestamp for t in record.tracked]), record.T_map_cam)
    if plot:
        draw_localization(plot, f"{source.name} in {stored_map.name}", record.tracked, T_true)
    _deliver("localization", {"trace": str(trace), "map": str(stored_map)}, {source.name: metrics}, json_file)


def _of_others(
    files: list[TrajectoryFile], timestamp: NDArray[np.float64], T_true: NDArray[np.float64]
) -> dict[str, Estimate]:
    """The poses of other systems by name of their file, with the truth of the frames that they cover."""
    found: dict[str, Estimate] = {}
    for file in files:
        covered, T_world_cam = file.matched(timestamp)
        stem = Path(file.source).stem
        name = file.source if stem in found or stem == "autowaze" else stem
        found[name] = Estimate(timestamp[covered], T_world_cam, T_true[covered])
    return found


def _deliver(title: str, inputs: dict[str, Any], results: Results, json_file: Path | None) -> None:
    print_metrics(title, results)
    if json_file:
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
