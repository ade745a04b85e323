"""Diffs that were not acknowledged yet, on disk, in the order in which they were made."""

from __future__ import annotations

import fcntl
import os
import threading
from collections import OrderedDict
from pathlib import Path

from autowaze.world.errors import AutowazeError

MOST_BYTES = 256 << 20
"""Two days of driving at 8 KB per window of 5 s."""
KEPT_REFUSED = 32


class OutboxError(AutowazeError):
    """The outbox cannot be used or written."""


class Outbox:
    """A folder with one file per diff. A file is whole or absent, and survives a power cut once `put` returns.

    When it is full the oldest diffs give way: what was seen last says most about what is free now.

    Args:
        folder: made if there is none; one car at a time may use it.
        most_bytes: of all diffs together.

    Raises:
        OutboxError: another car uses the folder, or it cannot be written.
    """

    def __init__(self, folder: str | Path, most_bytes: int = MOST_BYTES) -> None:
        self.folder = Path(folder)
        self._refused = self.folder / "refused"
        self._most_bytes = most_bytes
        self._guard = threading.Lock()
        self.dropped = 0
        """Diffs that gave way since the start."""
        try:
            self._refused.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self.folder / "lock", os.O_CREAT | os.O_RDWR, 0o600)
        except OSError as error:
            raise OutboxError(f"{self.folder}: cannot be used as an outbox: {error.strerror}") from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._lock)
            raise OutboxError(f"{self.folder}: another car uses this outbox; give each its own") from None
        for unfinished in self.folder.glob("*.partial"):
            unfinished.unlink()
        self._sizes = OrderedDict((int(path.stem), path.stat().st_size) for path in self._files())
        self._next = max([*self._sizes, *(int(path.stem) for path in self._refused.glob("*.diff"))], default=0) + 1

    def __len__(self) -> int:
        return len(self._sizes)

    def put(self, message: bytes) -> None:
        """Add a diff at the end; raises `OutboxError` if it could not be written."""
        with self._guard:
            self._make_room(len(message))
            path = self._path(self._next)
            partial = path.with_suffix(".partial")
            try:
                with partial.open("wb") as file:
                    file.write(message)
                    file.flush()
                    os.fsync(file.fileno())
                partial.replace(path)
                self._sync_folder()
            except OSError as error:
                raise OutboxError(f"{path}: cannot be written: {error.strerror}") from error
            self._sizes[self._next] = len(message)
            self._next += 1

    def first(self) -> tuple[int, bytes] | None:
        """Number and bytes of the oldest diff."""
        with self._guard:
            for number in list(self._sizes):
                try:
                    return number, self._path(number).read_bytes()
                except OSError:  # somebody tidied up, or the disk fails: go on with the next
                    del self._sizes[number]
                    self.dropped += 1
            return None

    def remove(self, number: int) -> None:
        """Take out a diff that was acknowledged."""
        with self._guard:
            self._take_out(number)

    def set_aside(self, number: int) -> None:
        """Keep a diff that the service will never take among the newest refused ones, for a person to look at."""
        with self._guard:
            if self._sizes.pop(number, None) is not None:
                self._path(number).replace(self._refused / self._path(number).name)
            for old in sorted(self._refused.glob("*.diff"))[:-KEPT_REFUSED]:
                old.unlink(missing_ok=True)

    def close(self) -> None:
        """Let another car use the folder."""
        os.close(self._lock)

    def _make_room(self, size: int) -> None:
        while self._sizes and sum(self._sizes.values()) + size > self._most_bytes:
            self._take_out(next(iter(self._sizes)))
            self.dropped += 1

    def _take_out(self, number: int) -> None:
        if self._sizes.pop(number, None) is not None:
            self._path(number).unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.glob("*.diff") if path.stem.isdecimal())

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:012d}.diff"

    def _sync_folder(self) -> None:
        folder = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
