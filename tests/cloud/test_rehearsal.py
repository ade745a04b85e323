"""A service that has rehearsed meets its first cars without a compiler."""

import subprocess
import sys
from pathlib import Path

FIRST_CARS = """
from dataclasses import replace

from numba.core.dispatcher import Dispatcher
from street import Street

from autowaze.cloud.rehearsal import rehearse
from autowaze.cloud.service import CloudService
from autowaze.world.wire import encode_diff

rehearse()
compiles, late = Dispatcher._compile_for_args, []
Dispatcher._compile_for_args = lambda self, *a, **k: late.append(self.py_func.__name__) or compiles(self, *a, **k)
street = Street()
service = CloudService(street.parking_map)
gone = []
for session in (1, 2, 3):
    diffs = street.drive(street.park([session, 2, 5, 9], session), session=session, start=1000.0 * session)
    for diff in diffs:
        service.receive(encode_diff(replace(diff, removed=gone.pop(0)) if gone else diff))
    gone = [diff.new.id for diff in diffs]
assert not late, late
"""


def test_nothing_is_left_to_compile() -> None:
    here = str(Path(__file__).parent)
    done = subprocess.run([sys.executable, "-c", FIRST_CARS], cwd=here, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
