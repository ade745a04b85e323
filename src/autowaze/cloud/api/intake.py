"""The one thread that touches the service: it takes in waiting diffs with one commit and answers questions between."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from autowaze.cloud.broadcast import Update
from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit
from autowaze.cloud.store import StoreError
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.parking import SpotState

MOST_WAITING = 512
"""Diffs that wait to be taken in, 2.5 s at 200 a second; the next one is told to come again."""
MOST_AT_ONCE = 8
"""Diffs that share a commit: more together cost no less each, and who came first would wait for the last."""
PROBE_S = 1.0
"""How often a store that does not answer is asked again while nobody hands anything in."""

_log = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")


class BusyError(AutowazeError):
    """More diffs wait than the service will hold in memory; the car sends this one again later."""


@dataclass(frozen=True)
class _Waiting:
    payload: bytes
    sender: str | None
    update: asyncio.Future[Update]


class Intake:
    """Takes diffs in one after the other, in the order of arrival, and tells everyone what changed.

    Args:
        durable: what accepts the diffs; nothing else may use it while the intake is open.
        publish: is called in the event loop with each accepted update, once it is durable, in the order of versions.
    """

    def __init__(
        self, durable: DurableService, publish: Callable[[Update], None], most_waiting: int = MOST_WAITING
    ) -> None:
        self._durable = durable
        self._publish = publish
        self._waiting: asyncio.Queue[_Waiting] = asyncio.Queue(most_waiting)
        self._thread = ThreadPoolExecutor(1, "intake")
        self._loop: asyncio.Task[None] | None = None
        self.keeps = True
        """Whether the last commit succeeded."""

    def open(self) -> None:
        """Begin to take in."""
        self._loop = asyncio.create_task(self._take_in_for_ever())

    async def close(self) -> None:
        """Finish the batch that is being taken in; those who still wait are refused and will come again."""
        if self._loop is None:
            return
        self._loop.cancel()
        await asyncio.gather(self._loop, return_exceptions=True)
        self._loop = None
        await asyncio.to_thread(self._thread.shutdown)
        while not self._waiting.empty():
            _resolve(self._waiting.get_nowait(), BusyError("the service is stopping: send it again"))

    @property
    def is_open(self) -> bool:
        """Whether diffs are taken in now."""
        return self._loop is not None and not self._loop.done()

    @property
    def waiting(self) -> int:
        """Diffs that wait."""
        return self._waiting.qsize()

    async def take_in(self, payload: bytes, sender: str | None = None) -> Update:
        """Take in the bytes of one diff from a token of this name, if any; what it returns is durable.

        Raises:
            WireError: no diff, or one that says something impossible; nothing has changed.
            StoreError: it could not be kept; nothing has changed, the car may send it again.
            BusyError: too many wait before it, or the service stops.
        """
        if not self.is_open:
            raise BusyError("the service is stopping: send it again")
        waiting = _Waiting(payload, sender, asyncio.get_running_loop().create_future())
        try:
            self._waiting.put_nowait(waiting)
        except asyncio.QueueFull:
            raise BusyError(f"{self._waiting.maxsize} diffs wait already: send it again later") from None
        try:
            return await waiting.update
        finally:
            del waiting  # an error leads here, and from here to itself

    async def ask(self, question: Callable[[CloudService], _Answer]) -> _Answer:
        """The answer of the service as of a commit; keep questions short, diffs wait meanwhile."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, lambda: question(self._durable.service))

    async def edit(self, edit: SpotEdit, actor: str, then: Callable[[], None]) -> tuple[int, SpotState | None]:
        """Draw or erase a spot; returns the version of the parking map and the state of the spot, both durable.

        Args:
            then: is called in the thread of the service before that answers another question.

        Raises:
            RefusedEditError: the spot cannot be so; nothing has changed.
            StoreError: it could not be kept; nothing has changed.
        """

        def make() -> tuple[int, SpotState | None]:
            made = self._durable.edit(edit, actor)
            then()
            return made

        return await asyncio.get_running_loop().run_in_executor(self._thread, make)

    async def _take_in_for_ever(self) -> None:
        while True:
            batch = [await self._next()]
            while len(batch) < MOST_AT_ONCE and not self._waiting.empty():
                batch.append(self._waiting.get_nowait())
            # Shielded: a batch that may already be committed is always answered, even when the service stops.
            taking_in = asyncio.ensure_future(self._take_in(batch))
            try:
                await asyncio.shield(taking_in)
            except asyncio.CancelledError:
                await taking_in
                raise

    async def _next(self) -> _Waiting:
        """The next one to take in; while nothing can be kept, see now and then whether the store is back."""
        while not self.keeps:
            with suppress(TimeoutError):
                return await asyncio.wait_for(self._waiting.get(), PROBE_S)
            with suppress(StoreError):
                await asyncio.get_running_loop().run_in_executor(self._thread, self._durable.mend)
                self.keeps = True
        return await self._waiting.get()

    async def _take_in(self, batch: list[_Waiting]) -> None:
        loop = asyncio.get_running_loop()
        try:
            payloads = [waiting.payload for waiting in batch]
            senders = [waiting.sender for waiting in batch]
            results = await loop.run_in_executor(self._thread, self._durable.receive_many, payloads, senders)
        except StoreError as error:
            self.keeps = False
            _log.error("not kept: %s", error)
            for waiting in batch:
                _resolve(waiting, error)
        except Exception as error:
            await self._isolate(batch, error)
        else:
            self.keeps = True
            for waiting, result in zip(batch, results, strict=True):
                if not isinstance(result, WireError) and result.accepted:
                    self._publish(result)
                _resolve(waiting, result)

    async def _isolate(self, batch: list[_Waiting], error: Exception) -> None:
        """One of them broke the service, which has recovered since: the others shall not suffer for it."""
        if len(batch) == 1:
            _log.error("a diff of %d bytes broke the service", len(batch[0].payload), exc_info=error)
            _resolve(batch[0], error)
            return
        for waiting in batch:
            await self._take_in([waiting])


def _resolve(waiting: _Waiting, result: Update | Exception) -> None:
    if waiting.update.done():  # the client has gone
        return
    if isinstance(result, Exception):
        waiting.update.set_exception(result)
    else:
        waiting.update.set_result(result)
