"""Proofs that cross a broker."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autowaze.world.acknowledgement import MOST_BYTES, Acknowledgement, Verdict, decode_acknowledgement
from autowaze.world.broker import BrokerAddress, car_of_topic, diffs_topic, new_car
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.signed_diff import HEADER_BYTES, parse_signed_diff, sign_diff

TOKEN, CAR, DIFF = "awz_" + "k" * 43, "0123456789abcdef", b"a diff"
HASH = hashlib.sha256(TOKEN.encode()).digest()
SIGNED = sign_diff(DIFF, CAR, TOKEN)


@given(st.binary(max_size=200), st.text(st.characters(codec="ascii", exclude_characters="\0"), min_size=1, max_size=64))
def test_the_hash_alone_tells_who_signed(diff, token):
    signed = parse_signed_diff(sign_diff(diff, CAR, token))
    token_hash = hashlib.sha256(token.encode()).digest()
    assert signed.diff == diff
    assert token_hash.startswith(signed.key_name)
    assert signed.token(token_hash, CAR) == token


@given(st.integers(12, len(SIGNED) - 1), st.integers(1, 255))
def test_a_changed_byte_proves_nothing(place, change):
    altered = bytearray(SIGNED)
    altered[place] ^= change
    assert parse_signed_diff(bytes(altered)).token(HASH, CAR) is None


def test_a_proof_fits_one_topic_and_one_token():
    signed = parse_signed_diff(SIGNED)
    assert signed.token(HASH, CAR) == TOKEN
    assert signed.token(HASH, CAR + "0") is None
    assert signed.token(hashlib.sha256(b"awz_other").digest(), CAR) is None
    assert TOKEN.encode() not in SIGNED
    assert not parse_signed_diff(sign_diff(DIFF, CAR, None)).is_signed


@given(st.binary(max_size=2 * HEADER_BYTES))
def test_any_bytes_are_a_message_or_an_error(data):
    try:
        parse_signed_diff(data).token(HASH, CAR)
    except WireError:
        return
    assert len(data) >= HEADER_BYTES


@pytest.mark.parametrize("token", ["", "x" * 65, "nul\0"])
def test_what_is_no_token_is_named(token):
    with pytest.raises(AutowazeError, match="token"):
        sign_diff(DIFF, CAR, token)


@given(st.sampled_from(Verdict), st.text(max_size=20_000), st.none() | st.integers(0, 1 << 62))
def test_an_acknowledgement_survives_and_stays_small(verdict, reason, version):
    data = Acknowledgement("ab" * 32, verdict, reason, version, 2.5).encode(CAR, HASH)
    assert len(data) <= MOST_BYTES
    received = decode_acknowledgement(data, CAR, TOKEN)
    assert (received.sha256, received.verdict, received.map_version) == ("ab" * 32, verdict, version)
    assert reason.startswith(received.reason)
    for car, token in ((CAR, "awz_other"), ("another", TOKEN)):
        with pytest.raises(WireError, match="not sealed"):
            decode_acknowledgement(data, car, token)
    with pytest.raises(WireError, match="not sealed"):
        decode_acknowledgement(data.replace(b"abab", b"cdcd"), CAR, TOKEN)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b"\xff",
        b"[" * 4000,
        b"{}" + b" " * MOST_BYTES,
        b'{"sha256": 7, "verdict": "accepted"}',
        b'{"sha256": "ab", "verdict": "perhaps"}',
        b'{"sha256": "ab", "verdict": ["accepted"]}',
    ],
)
def test_what_is_no_acknowledgement_is_refused(data):
    with pytest.raises(WireError, match="not an acknowledgement"):
        decode_acknowledgement(data)


def test_odd_members_of_an_acknowledgement_are_ignored():
    odd = b'{"sha256": "ab", "verdict": "later", "reason": {}, "map_version": true, "wait_s": 1e999}'
    assert decode_acknowledgement(odd) == Acknowledgement("ab", Verdict.LATER)


def test_topics_name_cars():
    car = new_car()
    assert car_of_topic(diffs_topic(car)) == car
    for topic in ("autowaze/v1/diffs/", "autowaze/v1/diffs/a/b", "autowaze/v1/diffs/" + "x" * 99, "elsewhere"):
        assert car_of_topic(topic) is None


def test_a_brokers_log_in_is_not_shown():
    address = BrokerAddress.parse("mqtts://car:s%40crt@[::1]")
    assert (address.host, address.port, address.tls, address.password) == ("::1", 8883, True, "s@crt")
    assert "s@crt" not in f"{address} {address!r}"
