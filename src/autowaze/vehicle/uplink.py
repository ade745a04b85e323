"""Diffs from the outbox to the service, one after the other, each until it is acknowledged."""

from __future__ import annotations

import hashlib
import json
import logging
import random
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

from autowaze.vehicle.connection import CloudConnection, Reply, UnreachableError
from autowaze.vehicle.outbox import Outbox

FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 60.0
DIFFS_PATH = "/v1/diffs"
_NEVER = {"not_a_diff", "diff_refused", "foreign_session", "too_large"}
"""The service's words for a diff that it will never take; any other refusal may be of the moment or of a proxy."""

_log = logging.getLogger(__name__)


class Outcome(Enum):
    """What became of a diff."""

    ACKNOWLEDGED = auto()
    REFUSED = auto()
    LATER = auto()


@dataclass(frozen=True)
class Answer:
    """What a transport says of a diff.

    Attributes:
        reason: for a person.
        wait_s: how long the service asked to wait, if it did.
    """

    outcome: Outcome
    reason: str = ""
    wait_s: float | None = None


class Transport(Protocol):
    """What carries diffs; several may share an uplink's rules."""

    def hand_in(self, message: bytes) -> Answer:
        """Try once."""

    def close(self) -> None:
        """Let go of what is held."""


class HttpTransport:
    """Hands diffs in over HTTP."""

    def __init__(self, connection: CloudConnection) -> None:
        self._connection = connection

    def hand_in(self, message: bytes) -> Answer:
        """Try once; only an answer that names the very bytes sent is an acknowledgement."""
        try:
            reply = self._connection.post(DIFFS_PATH, message)
        except UnreachableError as error:
            return Answer(Outcome.LATER, str(error))
        body = _json_object(reply.body)
        if reply.status in (200, 202) and body.get("sha256") == hashlib.sha256(message).hexdigest():
            return Answer(Outcome.ACKNOWLEDGED)
        reason = f"{self._connection.url}: {reply.status} {body.get('error_description', 'not our service?')}"
        if body.get("error") in _NEVER and 400 <= reply.status < 500:
            return Answer(Outcome.REFUSED, reason)
        return Answer(Outcome.LATER, reason, _retry_after_s(reply))

    def close(self) -> None:
        """Let go of the connection."""
        self._connection.close()


class Delivery:
    """Takes diffs out of an outbox and hands them in, oldest first, each until it is acknowledged or refused.

    Args:
        outbox: may hold diffs of an earlier drive; they go first.
        transport: carries them.
        randomness: 0..1, spreads the retries of many cars after an outage.

    Attributes:
        acknowledged, refused: how many diffs were.
        trouble: why the last attempt failed; empty after one that did not.
    """

    def __init__(self, outbox: Outbox, transport: Transport, randomness: Callable[[], float] = random.random) -> None:
        self.outbox = outbox
        self.acknowledged = 0
        self.refused = 0
        self.trouble = ""
        self._transport = transport
        self._randomness = randomness
        self._failures = 0

    def attempt(self) -> float | None:
        """Hand in the oldest diff once; returns how many seconds to wait then, None until there is a new diff."""
        item = self.outbox.first()
        if item is None:
            return None
        number, message = item
        answer = self._try(message)
        if answer.outcome is Outcome.LATER:
            return self._put_off(answer)
        self.trouble, self._failures = "", 0
        if answer.outcome is Outcome.ACKNOWLEDGED:
            self.acknowledged += 1  # before the outbox is empty: who waits for that reads the count then
            self.outbox.remove(number)
        else:
            _log.error("%s; the diff lies in %s/refused", answer.reason, self.outbox.folder)
            self.refused += 1
            self.outbox.set_aside(number)
        return 0.0

    def close(self) -> None:
        """Let go of connection and outbox."""
        self._transport.close()
        self.outbox.close()

    def _try(self, message: bytes) -> Answer:
        try:
            return self._transport.hand_in(message)
        except Exception as error:  # whatever a transport does, what lies in the outbox must not be stuck for ever
            _log.error("the transport failed", exc_info=error)
            return Answer(Outcome.LATER, f"the transport failed: {error!r}")

    def _put_off(self, answer: Answer) -> float:
        if not self.trouble:
            _log.warning("%s; diffs stay in %s until they are acknowledged", answer.reason, self.outbox.folder)
        self.trouble = answer.reason
        longest_s = min(FIRST_WAIT_S * 2.0 ** min(self._failures, 10), LONGEST_WAIT_S)
        self._failures += 1
        if answer.wait_s is not None:
            return min(answer.wait_s, LONGEST_WAIT_S)
        return longest_s * (0.5 + 0.5 * self._randomness())


class Uplink:
    """Sends what lies in the outbox in a thread of its own; arguments as for `Delivery`."""

    def __init__(self, outbox: Outbox, transport: Transport, randomness: Callable[[], float] = random.random) -> None:
        self.outbox = outbox
        self._delivery = Delivery(outbox, transport, randomness)
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="uplink", daemon=True)
        self._thread.start()

    @property
    def acknowledged(self) -> int:
        """Diffs acknowledged since the start."""
        return self._delivery.acknowledged

    @property
    def refused(self) -> int:
        """Diffs refused since the start."""
        return self._delivery.refused

    @property
    def trouble(self) -> str:
        """Why the last try failed; empty after one that did not."""
        return self._delivery.trouble

    def send(self, message: bytes) -> None:
        """Keep a diff on disk and send it as soon as may be; raises `OutboxError` if it could not be kept."""
        self.outbox.put(message)
        with self._changed:
            self._changed.notify_all()

    def flush(self, timeout_s: float) -> bool:
        """Wait until all is acknowledged or refused; False if some is left when time is up."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self.outbox) == 0, timeout_s)

    def close(self) -> None:
        """Stop; what is left stays in the outbox for the next start."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        self._thread.join()
        self._delivery.close()

    def _run(self) -> None:
        while not self._stopping:
            wait_s = self._delivery.attempt()
            with self._changed:
                self._changed.notify_all()
            if wait_s != 0.0:
                self._pause(wait_s)

    def _pause(self, wait_s: float | None) -> None:
        """Wait for the time, or for a new diff where no time is given; in either case for the order to stop."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopping or (wait_s is None and len(self.outbox) > 0), wait_s)


def _json_object(data: bytes) -> dict[str, object]:
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def _retry_after_s(reply: Reply) -> float | None:
    stated = reply.headers.get("retry-after", "")
    return min(float(stated), LONGEST_WAIT_S) if stated.isascii() and stated.isdecimal() else None
