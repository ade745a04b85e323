"""The service's side of an MQTT broker: diffs of cars come in, acknowledgements go back."""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Self

from paho.mqtt.client import MQTTMessage
from paho.mqtt.enums import MQTTProtocolVersion

from autowaze.cloud.api.diff_desk import DiffDesk
from autowaze.cloud.store.tokens import Scope, Token, TokenRegister
from autowaze.world.acknowledgement import Acknowledgement, Verdict
from autowaze.world.broker import EVERY_DIFF, BrokerAddress, acks_topic, car_of_topic, new_car
from autowaze.world.broker_session import NEWEST_FIRST, BrokerError, BrokerSession
from autowaze.world.errors import WireError
from autowaze.world.signed_diff import SignedDiff, parse_signed_diff

FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 15.0

_log = logging.getLogger(__name__)


class MqttGateway:
    """Subscribes to the diffs of all cars, for as long as the service runs, through every outage of the broker.

    The broker is trusted with nothing: it may lose, repeat and reorder messages, and who may publish is decided here,
    by the signature of each diff. A diff is acknowledged to its car after it is durable, sealed with the car's token;
    to the broker after that, so that the broker holds back what the service cannot yet take.

    Args:
        address: of the broker.
        desk: takes the diffs.
        tokens: the tokens that are good; None takes diffs from everyone.
        on_open: is called in the event loop with each new session.
        versions: of MQTT, tried in this order.
    """

    def __init__(
        self,
        address: BrokerAddress,
        desk: DiffDesk,
        tokens: TokenRegister | None,
        on_open: Callable[[BrokerSession], None] = lambda session: None,
        versions: Sequence[MQTTProtocolVersion] = NEWEST_FIRST,
    ) -> None:
        self.address = address
        self._desk = desk
        self._tokens = tokens
        self._on_open = on_open
        self._versions = versions
        self._answering: set[asyncio.Task[None]] = set()
        self._connecting: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Begin to connect."""
        self._connecting = asyncio.create_task(self._stay_connected())
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Answer what was received, then take leave of the broker."""
        if self._connecting is not None:
            self._connecting.cancel()
            await asyncio.gather(self._connecting, return_exceptions=True)

    async def _stay_connected(self) -> None:
        failures = 0
        while True:
            try:
                await self._one_session()
                failures = 0
            except BrokerError as error:
                _log.log(logging.DEBUG if failures else logging.WARNING, "%s; trying again", error)
                failures += 1
            await asyncio.sleep(min(FIRST_WAIT_S * 2.0 ** min(failures, 10), LONGEST_WAIT_S))

    async def _one_session(self) -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()

        def arrived(session: BrokerSession, message: MQTTMessage) -> None:
            with suppress(RuntimeError):  # the loop is closed: the service has stopped
                loop.call_soon_threadsafe(self._begin_answer, session, message)

        def broken() -> None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(ended.set)

        name = f"autowaze-service-{new_car()[:8]}"
        session = await asyncio.to_thread(
            BrokerSession, self.address, name, [EVERY_DIFF], arrived, broken, self._versions
        )
        try:
            _log.info("%s: connected", self.address)
            self._on_open(session)
            await ended.wait()
            _log.warning("%s: the connection broke; cars keep their diffs meanwhile", self.address)
        finally:
            await asyncio.gather(*self._answering, return_exceptions=True)
            await asyncio.to_thread(session.close)

    def _begin_answer(self, session: BrokerSession, message: MQTTMessage) -> None:
        answering = asyncio.create_task(self._answer(session, message))
        self._answering.add(answering)
        answering.add_done_callback(self._answering.discard)

    async def _answer(self, session: BrokerSession, message: MQTTMessage) -> None:
        car = car_of_topic(message.topic)
        if car is not None and not message.retain:
            answer = await self._judged(bytes(message.payload), car)
            with suppress(BrokerError):  # the car will ask again
                session.publish(acks_topic(car), answer)
        session.acknowledge(message)

    async def _judged(self, payload: bytes, car: str) -> bytes:
        """Hand in a message if it is properly signed; the bytes of the acknowledgement."""
        try:
            signed = parse_signed_diff(payload)
        except WireError as error:
            self._desk.turn_away(car, "not_signed", str(error))
            return _later(payload, str(error)).encode()
        if self._tokens is None:
            return (await self._desk.hand_in(signed.diff, car)).encode()
        known = self._signer(self._tokens, signed, car)
        if known is None:
            self._desk.turn_away(car, "unauthorized", reason := "no good token signed this diff")
            return _later(signed.diff, reason).encode()
        token, token_hash = known
        if Scope.DIFFS not in token.scopes:
            self._desk.turn_away(car, "forbidden", reason := f"this token lacks the scope {Scope.DIFFS}", token.name)
            return _later(signed.diff, reason).encode(car, token_hash)
        return (await self._desk.hand_in(signed.diff, token.name)).encode(car, token_hash)

    @staticmethod
    def _signer(tokens: TokenRegister, signed: SignedDiff, car: str) -> tuple[Token, bytes] | None:
        """Whose token signed, and its hash."""
        for token_hash in tokens.hashes(signed.key_name) if signed.is_signed else ():
            secret = signed.token(token_hash, car)
            token = tokens.find(secret) if secret is not None else None
            if token is not None:
                return token, token_hash
        return None


def _later(diff: bytes, reason: str) -> Acknowledgement:
    return Acknowledgement(hashlib.sha256(diff).hexdigest(), Verdict.LATER, reason)
