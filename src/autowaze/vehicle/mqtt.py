"""Diffs to the service by way of an MQTT broker."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence

from paho.mqtt.client import MQTTMessage
from paho.mqtt.enums import MQTTProtocolVersion

from autowaze.vehicle.uplink import Answer, Outcome
from autowaze.world.acknowledgement import Acknowledgement, Verdict, decode_acknowledgement
from autowaze.world.broker import BrokerAddress, acks_topic, diffs_topic, new_car
from autowaze.world.broker_session import NEWEST_FIRST, BrokerError, BrokerSession
from autowaze.world.errors import WireError
from autowaze.world.signed_diff import sign_diff

PATIENCE_S = 20.0
"""How long the service may take; it may just be starting."""


class MqttTransport:
    """Publishes diffs and waits for the service's own word on each: the broker's acknowledgement means nothing,
    brokers lose what they have acknowledged when they are killed.

    Args:
        address: of the broker.
        token: what the service knows the car by; the broker never sees it.
        patience_s: how long to wait for an acknowledgement.
        versions: of MQTT, tried in this order.
        name: draws the car's name at the broker, anew for each connection.
    """

    def __init__(
        self,
        address: BrokerAddress,
        token: str | None = None,
        patience_s: float = PATIENCE_S,
        versions: Sequence[MQTTProtocolVersion] = NEWEST_FIRST,
        name: Callable[[], str] = new_car,
    ) -> None:
        self.address = address
        self._token = token
        self._patience_s = patience_s
        self._versions = versions
        self._name = name
        self._session: BrokerSession | None = None
        self._car = ""
        self._awaited = ""
        self._answered = threading.Condition()
        self._answer: Acknowledgement | None = None
        self._doubt = ""

    def hand_in(self, message: bytes) -> Answer:
        """Try once; only the service's acknowledgement of the very bytes counts."""
        sha256 = hashlib.sha256(message).hexdigest()
        try:
            session = self._open_session()
            with self._answered:
                self._awaited, self._answer, self._doubt = sha256, None, ""
                session.publish(diffs_topic(self._car), sign_diff(message, self._car, self._token))
                self._answered.wait_for(lambda: self._answer is not None or not session.is_open, self._patience_s)
                answer, self._awaited = self._answer, ""
        except BrokerError as error:
            self._drop_session()
            return Answer(Outcome.LATER, str(error))
        if answer is None:
            self._drop_session()
            return Answer(Outcome.LATER, f"{self.address}: {self._doubt or 'no acknowledgement from the service'}")
        reason = f"{self.address}: {answer.reason}"
        if answer.verdict in (Verdict.ACCEPTED, Verdict.REPEATED):
            return Answer(Outcome.ACKNOWLEDGED)
        if answer.verdict is Verdict.REFUSED:
            return Answer(Outcome.REFUSED, reason)
        return Answer(Outcome.LATER, reason, answer.wait_s)

    def close(self) -> None:
        """Take leave of the broker."""
        self._drop_session()

    def _open_session(self) -> BrokerSession:
        if self._session is None or not self._session.is_open:
            self._drop_session()
            self._car = self._name()
            topics = [acks_topic(self._car)]
            self._session = BrokerSession(
                self.address, self._car, topics, self._take, self._wake, versions=self._versions
            )
            self._versions = [self._session.version]
        return self._session

    def _drop_session(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None

    def _take(self, session: BrokerSession, message: MQTTMessage) -> None:
        session.acknowledge(message)
        with self._answered:
            try:
                answer = decode_acknowledgement(bytes(message.payload), self._car, self._token)
            except WireError as error:
                self._doubt = str(error)
                return
            if answer.sha256 == self._awaited:
                self._answer = answer
                self._answered.notify_all()

    def _wake(self) -> None:
        with self._answered:
            self._answered.notify_all()
