"""`autowaze cloud` in a process of its own, and its public feeds."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from autowaze.cloud.methods import FUSED
from autowaze.vehicle.connection import CloudConnection
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import Occupancy, SpotState

HOST = "127.0.0.1"
_MOST_BYTES = 1 << 24
_GRACE_S = 15.0


class LiveService:
    """A service on this machine, open to all; time stands at the newest observation.

    Args:
        spots: parking map, GeoJSON.
        folder: for its store and its log.
        port: to listen on; another one where it is taken, any free one for 0.
        base_map: the map to start from; an empty one without.
        streets: what the live map shows around the spots, GeoJSON.
        method: how spots are decided.

    Attributes:
        url: where it answers.

    Raises:
        AutowazeError: it did not start.
    """

    def __init__(
        self,
        spots: Path,
        folder: Path,
        port: int = 0,
        base_map: Path | None = None,
        streets: Path | None = None,
        method: str = FUSED.name,
    ) -> None:
        command: list[str | Path] = [
            *(sys.executable, "-m", "autowaze", "cloud", "--open", "--replay"),
            *("--spots", spots, "--method", method),
            *(("--streets", streets) if streets else ()),
            *(("--map", base_map) if base_map else ()),
            *("--store", folder / "service.db", "--host", HOST, "--port", str(_free_port(port))),
        ]
        log = folder / "service.log"
        with log.open("w", encoding="utf-8") as errors:
            # a session of its own: Ctrl-C is for who started it, and that stops it in order
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,
            )
        assert self._process.stdout is not None
        address = re.match(r"http\S+", self._process.stdout.readline())
        if address is None:
            self.close()
            said = log.read_text(encoding="utf-8").strip().splitlines() or ["nothing"]
            raise AutowazeError(f"the service did not start; the last line of {log}: {said[-1]}")
        self.url = address[0]

    def spots(self) -> list[SpotState]:
        """What it tells everyone of its spots now."""
        found = []
        for feature in self._get("/spots.geojson")["features"]:
            said = feature["properties"]
            state = Occupancy(said["state"])
            found.append(SpotState(said["spot_id"], state, said["probability"], said["observed_at"]))
        return found

    def stages_ms(self) -> dict[str, float]:
        """Median time of each of its stages, milliseconds."""
        return {str(stage): float(ms) for stage, ms in self._get("/stats")["stages_ms"].items()}

    def listeners(self) -> int:
        """How many follow its changes, as the live map does."""
        return int(self._get("/stats")["listeners"])

    def close(self) -> None:
        """Stop it."""
        self._process.terminate()
        try:
            self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _get(self, path: str) -> Any:
        with CloudConnection(self.url) as connection:
            reply = connection.get(path, _MOST_BYTES)
        if reply.status != 200:
            raise AutowazeError(f"{self.url}{path}: the service answered {reply.status}")
        return json.loads(reply.body)


def _free_port(wanted: int) -> int:
    """The port, or 0 for any where it is taken."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((HOST, wanted))
        except OSError:
            return 0
    return wanted
