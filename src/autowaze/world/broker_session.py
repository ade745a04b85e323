"""One connection to an MQTT broker, from CONNECT until it breaks; whoever wants another one opens another one."""

from __future__ import annotations

import logging
import socket
import ssl
import threading
from collections.abc import Callable, Sequence
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from autowaze.world.broker import BrokerAddress
from autowaze.world.errors import AutowazeError
from autowaze.world.signed_diff import HEADER_BYTES
from autowaze.world.wire import MAX_MESSAGE_BYTES

MOST_PACKET_BYTES = MAX_MESSAGE_BYTES + HEADER_BYTES + 1024
MOST_IN_FLIGHT = 64
KEEPALIVE_S = 30
CONNECT_S = 10.0
NEWEST_FIRST = (MQTTProtocolVersion.MQTTv5, MQTTProtocolVersion.MQTTv311)
"""Protocol versions to try; nats-server speaks 3.1.1 only."""
_UNSUPPORTED_VERSION = 0x84
_FAILURE = 0x80

_log = logging.getLogger(__name__)


class BrokerError(AutowazeError):
    """The broker cannot be reached, or does not let one in."""


class BrokerSession:
    """A connection with its subscriptions; keeps nothing that the broker or the network loses.

    Args:
        address: of the broker.
        client_id: by which access rules of the broker may know who publishes on which topic.
        topics: to subscribe to, with quality of service 1.
        on_message: is called in the session's thread. The broker holds back after `MOST_IN_FLIGHT` messages that were
            not given to `acknowledge`.
        on_end: is called in the session's thread when the connection is gone.
        versions: of the protocol, tried in this order.

    Raises:
        BrokerError: nobody listens there, the log-in is refused, or a subscription is.
    """

    def __init__(
        self,
        address: BrokerAddress,
        client_id: str,
        topics: Sequence[str],
        on_message: Callable[[BrokerSession, paho.MQTTMessage], None],
        on_end: Callable[[], None] = lambda: None,
        versions: Sequence[MQTTProtocolVersion] = NEWEST_FIRST,
    ) -> None:
        self.address = address
        self._topics = topics
        self._on_message = on_message
        self._on_end = on_end
        for version in versions:
            self._settled = threading.Event()
            self._refusal: int | None = None
            self._trouble = ""
            self._ready = False
            self.ended = threading.Event()
            self._client = self._new_client(client_id, version)
            self._connect()
            if self._ready:
                self.version = version
                return
            self.close()
            if self._refusal != _UNSUPPORTED_VERSION:
                break
        raise BrokerError(f"{address}: {self._trouble or f'no answer within {CONNECT_S:g} s'}")

    @property
    def is_open(self) -> bool:
        """Whether messages can come and go."""
        return self._ready and not self.ended.is_set()

    def publish(self, topic: str, payload: bytes, retain: bool = False) -> None:
        """Hand a message to the broker, at least once while the session lasts; raises `BrokerError` after its end."""
        sent = self.is_open and self._client.publish(topic, payload, qos=1, retain=retain).rc
        if sent is False or sent != MQTTErrorCode.MQTT_ERR_SUCCESS:
            raise BrokerError(f"{self.address}: the connection is gone")

    def acknowledge(self, message: paho.MQTTMessage) -> None:
        """Let the broker send another message in place of this one."""
        self._client.ack(message.mid, message.qos)

    def close(self) -> None:
        """Take leave of the broker."""
        self._client.disconnect()
        self._client.loop_stop()

    def _new_client(self, client_id: str, version: MQTTProtocolVersion) -> paho.Client:
        client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id,
            None if version == MQTTProtocolVersion.MQTTv5 else True,
            protocol=version,
            reconnect_on_failure=False,
            manual_ack=True,
        )
        if self.address.tls:
            client.tls_set_context(ssl.create_default_context())
        if self.address.username is not None:
            client.username_pw_set(self.address.username, self.address.password)
        client.connect_timeout = CONNECT_S
        client.max_inflight_messages_set(MOST_IN_FLIGHT)
        client.on_socket_open = _send_at_once
        client.on_connect = self._connected
        client.on_subscribe = self._subscribed
        client.on_disconnect = self._disconnected
        client.on_message = lambda _client, _data, message: self._on_message(self, message)
        return client

    def _connect(self) -> None:
        client, properties = self._client, None
        if client.protocol == MQTTProtocolVersion.MQTTv5:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = MOST_PACKET_BYTES
            properties.ReceiveMaximum = MOST_IN_FLIGHT
        try:
            client.connect(self.address.host, self.address.port, KEEPALIVE_S, properties=properties)
        except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
            raise BrokerError(f"{self.address}: {error}") from error
        client.loop_start()
        self._settled.wait(CONNECT_S)

    def _connected(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._refusal, self._trouble = reason.value, f"the broker refuses the log-in: {reason}"
            self._settled.set()
        elif self._topics:
            client.subscribe([(topic, 1) for topic in self._topics])
        else:
            self._ready = True
            self._settled.set()

    def _subscribed(self, client: paho.Client, data: Any, mid: int, reasons: list[Any], properties: Any) -> None:
        refused = [topic for topic, code in zip(self._topics, reasons, strict=False) if code.value >= _FAILURE]
        if refused:
            self._trouble = f"the broker refuses to pass on {', '.join(refused)}: see its access rules"
        else:
            self._ready = True
        self._settled.set()

    def _disconnected(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        self._trouble = self._trouble or f"the connection broke: {reason}"
        self.ended.set()
        self._settled.set()
        if self._ready:
            self._on_end()


def _send_at_once(client: paho.Client, data: Any, connection: Any) -> None:
    # Nagle's algorithm makes a small packet wait until the broker's delayed acknowledgement of the one before it.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
