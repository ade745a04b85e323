"""What the service says of a diff that did not come over HTTP: JSON, with a seal that only the service can make."""

from __future__ import annotations

import hashlib
import hmac
import json
from dataclasses import dataclass
from enum import StrEnum

from autowaze.world.errors import WireError

MOST_BYTES = 1 << 12
_MOST_WAIT_S = 3600.0


class Verdict(StrEnum):
    """What became of a diff."""

    ACCEPTED = "accepted"
    """It is durable."""
    REPEATED = "repeated"
    """It had been accepted before; nothing changed."""
    REFUSED = "refused"
    """It will never be accepted."""
    LATER = "later"
    """Not now; the car sends it again."""


@dataclass(frozen=True)
class Acknowledgement:
    """The service's word on one diff.

    Attributes:
        sha256: hexadecimal, of the bytes of the diff.
        reason: for a person; empty where all is well.
        map_version: of the map that holds the diff, if it was accepted.
        wait_s: how long the service asks to wait, if it does.
    """

    sha256: str
    verdict: Verdict
    reason: str = ""
    map_version: int | None = None
    wait_s: float | None = None

    def encode(self, car: str = "", token_hash: bytes | None = None) -> bytes:
        """JSON; sealed for a car's topic where the car has a token."""
        document: dict[str, object] = {
            "sha256": self.sha256,
            "verdict": self.verdict.value,
            "reason": self.reason[: MOST_BYTES // 8],
            "map_version": self.map_version,
            "wait_s": self.wait_s,
        }
        if token_hash is not None:
            document["seal"] = _seal(token_hash, car, self.sha256, self.verdict)
        return json.dumps(document, separators=(",", ":")).encode()


def decode_acknowledgement(data: bytes, car: str = "", token: str | None = None) -> Acknowledgement:
    """The acknowledgement in these bytes.

    Args:
        car: last level of the topic that it came on.
        token: of the car. One that has a token believes only what is sealed with it.

    Raises:
        WireError: they are none, or a car with a token finds no good seal.
    """
    try:
        document = json.loads(data) if len(data) <= MOST_BYTES else None
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise WireError("not an acknowledgement: no JSON object")
    sha256, verdict = document.get("sha256"), document.get("verdict")
    reason, version, wait_s = document.get("reason"), document.get("map_version"), document.get("wait_s")
    if not isinstance(sha256, str) or verdict not in list(Verdict):
        raise WireError("not an acknowledgement: sha256 or verdict is missing")
    if token is not None:
        seal = str(document.get("seal")).encode()
        expected = _seal(hashlib.sha256(token.encode()).digest(), car, sha256, Verdict(verdict))
        if not hmac.compare_digest(seal, expected.encode()):
            raise WireError("the acknowledgement is not sealed by a service that knows this car's token")
    return Acknowledgement(
        sha256,
        Verdict(verdict),
        reason if isinstance(reason, str) else "",
        version if type(version) is int else None,
        float(wait_s) if isinstance(wait_s, int | float) and 0 <= wait_s <= _MOST_WAIT_S else None,
    )


def _seal(token_hash: bytes, car: str, sha256: str, verdict: Verdict) -> str:
    sealed = f"autowaze acknowledgement 1\0{car}\0{sha256}\0{verdict.value}".encode(errors="replace")
    return hmac.digest(token_hash, sealed, "sha256").hex()
