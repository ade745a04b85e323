"""`autowaze drive`: one car over a trace, cloud in the same process or over the network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from autowaze.cli.options import (
    Cameras,
    Frames,
    JsonFile,
    Model,
    Spots,
    TracePath,
    console,
    opened,
    parking_map,
    print_metrics,
    segmenter,
    show_progress,
)
from autowaze.cli.remote_drive import (
    RemoteCloud,
    downlink_from,
    first_map,
    in_the_services_frame,
    known_spots,
    show_arrivals,
    uplink_to,
)
from autowaze.cloud.service import CloudService
from autowaze.evaluation.birdseye import draw_birdseye
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.latency import latency_metrics
from autowaze.evaluation.network import network_metrics
from autowaze.evaluation.overlay import OverlayVideo
from autowaze.evaluation.report import report, write_report
from autowaze.traces import Trace
from autowaze.vehicle.node import NodeSettings, VehicleNode
from autowaze.vehicle.pace import FRAMES, measure_pace
from autowaze.vehicle.private_ends import PrivateEnds
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.map_file import load_map
from autowaze.world.parking import Occupancy, ParkingMap


def drive(
    trace: TracePath,
    spots: Spots = None,
    model: Model = None,
    stored_map: Annotated[Path | None, typer.Option("--map", help="Stored map to localise in.")] = None,
    cameras: Cameras = "auto",
    frames: Frames = "",
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.GNSS,
    method: Annotated[str, typer.Option(help="How the cloud decides: thesis or fused.")] = "fused",
    plot: Annotated[Path | None, typer.Option(help="Draw the bird's-eye view into this picture.")] = None,
    video: Annotated[Path | None, typer.Option(help="Overlays: an .mp4 file, or a folder of pictures.")] = None,
    vacant: Annotated[Path | None, typer.Option(help="Write the vacant rectangles (JSON) here.")] = None,
    json_file: JsonFile = None,
    cloud_url: Annotated[
        str | None,
        typer.Option("--cloud", help="Send to the service (http[s], ws[s]) or the broker (mqtt[s]) at this URL."),
    ] = None,
    service: Annotated[
        str | None, typer.Option(help="URL of the service for its map, where --cloud is a broker.")
    ] = None,
    token: Annotated[str | None, typer.Option(help="Token for the service.", envvar="AUTOWAZE_TOKEN")] = None,
    outbox: Annotated[Path | None, typer.Option(help="Where diffs wait for the service; else in your home.")] = None,
    private_ends: Annotated[
        float, typer.Option(help="Metres at the beginning and end of a drive that the service is not told of.", min=0)
    ] = 0.0,
    segment_every: Annotated[
        int | None,
        typer.Option(
            help="Segment every n-th frame and follow the masks between. Without this every frame; with --cloud as "
            "many as this machine, by a measurement, has time for.",
            min=1,
            show_default=False,
        ),
    ] = None,
) -> None:
    """Drive a trace and say which spots are free, or let a service say it.

    Examples:

        autowaze drive drives/monday --spots street.geojson --map street.map --plot monday.png

        autowaze drive kitti/odometry_00 --spots kitti/odometry_00/parking_map.geojson --start first-true-pose
        --video overlays/

        autowaze drive drives/monday --cloud https://parking.example --token awz_...

        autowaze drive drives/monday --cloud mqtts://broker.example --service https://parking.example --token awz_...
    """
    source = opened(trace, cameras, frames)
    if cloud_url is not None:
        if plot or vacant:
            raise AutowazeError("--plot and --vacant show a cloud in the same process; ask the service for /vacant")
        remote = RemoteCloud(cloud_url, service, token)
        stored = load_map(stored_map) if stored_map else first_map(remote, source)
        begin = in_the_services_frame(starting_point(source, parking_map(spots), start), stored)
        known = known_spots(remote, source, stored.georeference)
        eyes = segmenter(model)
        settings = NodeSettings(segment_every=segment_every or _affordable(eyes, source))
        node = VehicleNode(source.camera, eyes, settings, stored_map=stored, start=begin, spots=known)
        with (
            OverlayVideo.open(video) as overlays,
            uplink_to(remote, outbox) as uplink,
            downlink_from(remote, stored) as downlink,
        ):
            send = PrivateEnds(private_ends, uplink.send).send if private_ends else uplink.send
            record = run_drive(source, node, send, show_progress, overlays.add, downlink, show_arrivals)
        results = {
            source.name: {
                "segment_every": settings.segment_every,
                **latency_metrics(record, node),
                **network_metrics(record),
            }
        }
        print_metrics("drive", results)
        if json_file:
            write_report(json_file, report({"trace": str(trace), "model": str(model), "start": start}, results))
        return
    if spots is None:
        raise AutowazeError("no cloud: give a parking map with --spots FILE.geojson, or a service with --cloud URL")
    marked_spots = ParkingMap.from_geojson(spots)
    base_map = load_map(stored_map) if stored_map else None
    cloud = CloudService(marked_spots, method=method, base_map=base_map)
    node = VehicleNode(
        source.camera,
        segmenter(model),
        NodeSettings(segment_every=segment_every or 1),
        stored_map=base_map,
        start=starting_point(source, marked_spots, start),
        spots=marked_spots,
    )
    with OverlayVideo.open(video) as overlays:
        record = run_drive(source, node, cloud.receive, show_progress, overlays.add)
    for index, state, reason in record.state_changes():
        console.print(f"frame {index}: {state}{': ' + reason if reason else ''}")
    counts = {state: sum(s.occupancy is state for s in cloud.states) for state in Occupancy}
    console.print(", ".join(f"{n} {state}" for state, n in counts.items()) + f" of {len(cloud.states)} spots")
    results = {source.name: {**latency_metrics(record, node, cloud), **network_metrics(record)}}
    print_metrics("drive", results)
    if plot:
        draw_birdseye(plot, record.T_map_cam, cloud, title=f"{source.name}, method {method}")
    if vacant:
        vacant.write_text(json.dumps(cloud.vacant(), indent=1) + "\n", encoding="utf-8")
    if json_file:
        inputs = {"trace": str(trace), "spots": str(spots), "model": str(model), "method": method, "start": start}
        write_report(json_file, report(inputs, results))


def _affordable(eyes: Segmenter, source: Trace) -> int:
    """Frames from one segmentation to the next, so that this machine keeps up with the cameras; says if it is not 1."""
    frames = [source[row] for row in range(min(FRAMES, len(source)))]
    if len(frames) < FRAMES:
        return 1
    interval_s = (frames[-1].timestamp - frames[0].timestamp) / (FRAMES - 1)
    pace = measure_pace(eyes, source.camera, frames, interval_s)
    if pace.every_nth > 1:
        console.print(
            f"a frame takes {1000 * pace.rest_s:.0f} ms here, with segmentation {1000 * pace.segment_s:.0f} more; they "
            f"come every {1000 * interval_s:.0f} ms: one of {pace.every_nth} is segmented, masks are followed between"
            + ("" if pace.keeps_up else ", and even so the car falls behind")
        )
    return pace.every_nth
