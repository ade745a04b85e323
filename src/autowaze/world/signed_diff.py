"""Diffs that cross a broker: a car proves that it holds its token without showing it to anyone.

The method is SCRAM's (RFC 5802, sec. 3) without its round trip: the proof is the token under a one-time pad that
follows from the token's hash and from what is signed. A service that holds only the hash takes the pad off and sees
whether what remains has that hash. Neither who listens at the broker nor who has read the service's store can sign
anything; only one who did both could. A proof fits one diff on one topic. docs/wire-format.md is the specification.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass

from autowaze.world.errors import AutowazeError, WireError

MAGIC = b"AWM1"
KEY_NAME_BYTES = 8
MOST_TOKEN_BYTES = 64
HEADER_BYTES = len(MAGIC) + KEY_NAME_BYTES + MOST_TOKEN_BYTES


@dataclass(frozen=True)
class SignedDiff:
    """A diff with the proof of who sends it.

    Attributes:
        key_name: (8 bytes) the beginning of the token's hash; zeros for a car without token.
        proof: (64 bytes) the token under its pad.
        diff: the bytes of a semantic map diff, not looked at here.
    """

    key_name: bytes
    proof: bytes
    diff: bytes

    @property
    def is_signed(self) -> bool:
        """Whether the car claims to hold a token."""
        return any(self.key_name)

    def token(self, token_hash: bytes, car: str) -> str | None:
        """The token that signed this for a car's topic, if its SHA-256 is `token_hash`; else None."""
        pad = _pad(token_hash, car, self.diff)
        token = bytes(a ^ b for a, b in zip(self.proof, pad, strict=True)).rstrip(b"\0")
        return token.decode() if hmac.compare_digest(hashlib.sha256(token).digest(), token_hash) else None


def sign_diff(diff: bytes, car: str, token: str | None) -> bytes:
    """The bytes that a car publishes.

    Args:
        diff: of `encode_diff`.
        car: the last level of the topic that it publishes to.
        token: what the service knows it by; None for a service that asks for none.

    Raises:
        AutowazeError: this cannot be a token.
    """
    if token is None:
        return MAGIC + bytes(KEY_NAME_BYTES + MOST_TOKEN_BYTES) + diff
    secret = token.encode()
    if not 0 < len(secret) <= MOST_TOKEN_BYTES or b"\0" in secret:
        raise AutowazeError(f"a token has 1 to {MOST_TOKEN_BYTES} characters; this one is none of the service's")
    token_hash = hashlib.sha256(secret).digest()
    padded = secret.ljust(MOST_TOKEN_BYTES, b"\0")
    proof = bytes(a ^ b for a, b in zip(padded, _pad(token_hash, car, diff), strict=True))
    return MAGIC + token_hash[:KEY_NAME_BYTES] + proof + diff


def parse_signed_diff(message: bytes) -> SignedDiff:
    """Take a message apart; nothing is proven yet. Raises `WireError` if it is none."""
    if len(message) < HEADER_BYTES or not message.startswith(MAGIC):
        raise WireError("not a signed diff: docs/wire-format.md says what a car publishes")
    key_end = len(MAGIC) + KEY_NAME_BYTES
    return SignedDiff(message[len(MAGIC) : key_end], message[key_end:HEADER_BYTES], message[HEADER_BYTES:])


def _pad(token_hash: bytes, car: str, diff: bytes) -> bytes:
    """64 bytes that only who knows the token's hash can work out."""
    signed = b"autowaze signed diff 1\0" + car.encode() + b"\0" + hashlib.sha256(diff).digest()
    return hmac.digest(token_hash, signed, "sha512")
