"""A snapshot packed by a copy of the process, while the process goes on.

Packing the state of a city takes an interpreter seconds, and diffs would wait for it. The kernel copies a process in
milliseconds, and of its memory only what changes afterwards: the copy holds the state as it was, packs it and is gone.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import BinaryIO

from autowaze.cloud.snapshot import Kept, SnapshotError, pack, pack_into

PART_BYTES = 1 << 17
"""Diffs wait while one is written."""
_PR_SET_PDEATHSIG = 1
_UNHURRIED = 19
"""Niceness of the copy: diffs go first."""
_RESTS = 4.0

_log = logging.getLogger(__name__)
_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


class GivenUpError(SnapshotError):
    """Nobody wants the snapshot any more."""


class Packing:
    """Packs what `kept` returns now; in a context it yields the bytes, part by part.

    Nothing that `kept` reads may change while this is made, and everything may from then on. Where the process cannot
    be copied, it packs by itself, at once.

    Args:
        kept: what parts of a service hold, by name.
        until: with this the copy rests four times as long as it works, for on a small machine even a copy on another
            core slows the process down; and gives up when it is set.
    """

    def __init__(self, kept: Callable[[], Kept], until: threading.Event | None = None) -> None:
        self._process = 0
        self._packed = b""
        self._until = until
        if _libc is None or not self._copied(kept):
            self._packed = pack(kept())

    def __enter__(self) -> Iterator[bytes]:
        return self._parts()

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process:  # its bytes are not wanted any more
            os.kill(self._process, signal.SIGKILL)
            self._ended()

    def _parts(self) -> Iterator[bytes]:
        """The bytes; raises `SnapshotError` in place of the end if the copy did not reach it."""
        if not self._process:
            yield self._packed
            return
        with open(self._pipe, "rb", buffering=PART_BYTES, closefd=False) as packed:
            while part := packed.read(PART_BYTES):
                if self._until is not None and self._until.is_set():
                    raise GivenUpError("a snapshot was given up")
                yield part
        status = self._ended()
        if status != 0:
            raise SnapshotError(f"the copy of the process that packed a snapshot ended with status {status}")

    def _copied(self, kept: Callable[[], Kept]) -> bool:
        own = os.getpid()
        reading, writing = os.pipe()
        try:
            with warnings.catch_warnings():  # Python 3.12 warns of other threads' locks: the copy takes none
                warnings.simplefilter("ignore", DeprecationWarning)
                process = os.fork()
        except OSError as error:  # too little memory, should all of it change
            _log.warning("the process cannot be copied to pack a snapshot, diffs wait for it: %s", error)
            os.close(reading)
            os.close(writing)
            return False
        if process == 0:
            _pack_and_end(own, writing, kept, 0.0 if self._until is None else _RESTS)
        os.close(writing)
        self._process, self._pipe = process, reading
        return True

    def _ended(self) -> int:
        """Status of the copy; waits for its end."""
        status = os.waitstatus_to_exitcode(os.waitpid(self._process, 0)[1])
        os.close(self._pipe)
        self._process = 0
        return status


class _Resting:
    """Passes on what is written, and then sleeps for so many times as it took to make."""

    def __init__(self, stream: BinaryIO, rests: float) -> None:
        self._stream, self._rests = stream, rests
        self._worked = time.process_time()

    def write(self, part: bytes) -> None:
        """Pass on a part."""
        self._stream.write(part)
        time.sleep(self._rests * (time.process_time() - self._worked))
        self._worked = time.process_time()


def _pack_and_end(parent: int, writing: int, kept: Callable[[], Kept], rests: float) -> None:
    """The life of the copy: it uses nothing but memory and the pipe, for everything else is still the process's."""
    status = 1
    try:
        gc.disable()
        assert _libc is not None
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            return
        # Sockets that the process closes would stay open here, and so would the lock of its store.
        os.closerange(3, writing)
        os.closerange(writing + 1, os.sysconf("SC_OPEN_MAX"))
        os.nice(_UNHURRIED)
        with open(writing, "wb", buffering=PART_BYTES) as packed:
            pack_into(_Resting(packed, rests).write, kept())
        status = 0
    except Exception as error:
        os.write(2, f"a snapshot could not be packed: {error!r}\n".encode())  # no stream: its lock may be held for ever
    finally:
        os._exit(status)
