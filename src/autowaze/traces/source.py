"""From a path to a trace."""

from __future__ import annotations

from pathlib import Path

from autowaze.traces.kitti import KittiTrace
from autowaze.traces.recorded import RecordedTrace
from autowaze.traces.trace import Trace
from autowaze.world.errors import TraceError


def open_trace(path: str | Path, cameras: str = "auto", frames: slice | None = None) -> Trace:
    """Open the drive in a folder, guessing the kind of source from what lies in it.

    Args:
        path: the folder of the drive.
        cameras: which pair of a rig with two, "grey", "colour" or "auto".
        frames: frame numbers to keep.

    Raises:
        TraceError: the folder is missing, of no known kind, or damaged.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise TraceError(f"{folder}: no such folder; give the folder of a stereo drive")
    if KittiTrace.recognises(folder):
        return KittiTrace(folder, cameras=cameras, frames=frames)
    if RecordedTrace.recognises(folder):
        return RecordedTrace(folder, frames=frames)
    raise TraceError(
        f"{folder}: not a known kind of stereo drive; expected an Autowaze trace (trace.json), KITTI odometry "
        "(image_0, image_1, calib.txt) or KITTI raw (image_00/data, image_01/data, calib_cam_to_cam.txt)"
    )
