"""The seal of the law's link: no change, other direction, other session or other key passes."""

from hypothesis import given
from hypothesis import strategies as st

from companion.law_link.sealing import TAG_BYTES, Seal, hello_seal, session_keys

DATA = st.binary(min_size=1, max_size=200)
KEYS = st.binary(min_size=16, max_size=64)
NONCES = st.binary(min_size=16, max_size=16)


@given(DATA, KEYS)
def test_what_is_sealed_opens_with_the_same_key_and_is_8_bytes_longer(data: bytes, key: bytes) -> None:
    datagram = hello_seal(key).sealed(data)
    assert len(datagram) == len(data) + TAG_BYTES == len(data) + 8
    assert hello_seal(key).opened(datagram) == data


@given(DATA, KEYS, KEYS)
def test_another_key_opens_nothing(data: bytes, key: bytes, other: bytes) -> None:
    opened = hello_seal(other).opened(hello_seal(key).sealed(data))
    assert opened == (data if key == other else None)


@given(DATA, KEYS, st.data())
def test_no_flipped_bit_passes(data: bytes, key: bytes, draw: st.DataObject) -> None:
    datagram = bytearray(hello_seal(key).sealed(data))
    bit = draw.draw(st.integers(0, 8 * len(datagram) - 1))
    datagram[bit // 8] ^= 1 << bit % 8
    assert hello_seal(key).opened(bytes(datagram)) is None


@given(st.binary(max_size=200))
def test_bytes_of_a_stranger_open_nothing(datagram: bytes) -> None:
    assert hello_seal(b"the key of this vehicle").opened(datagram) is None


@given(KEYS, NONCES, NONCES, DATA)
def test_a_message_up_is_none_down_and_no_hello(key: bytes, ground: bytes, vehicle: bytes, data: bytes) -> None:
    keys = session_keys(key, ground, vehicle)
    datagram = keys.up.sealed(data)
    assert keys.up.opened(datagram) == data
    assert keys.down.opened(datagram) is None
    assert hello_seal(key).opened(datagram) is None


@given(KEYS, NONCES, NONCES, NONCES, DATA)
def test_a_message_of_an_earlier_session_does_not_pass_in_a_later_one(
    key: bytes, ground: bytes, first: bytes, second: bytes, data: bytes
) -> None:
    datagram = session_keys(key, ground, first).up.sealed(data)
    opened = session_keys(key, ground, second).up.opened(datagram)
    assert opened == (data if first == second else None)


def test_a_tag_alone_is_no_message() -> None:
    seal = Seal(bytes(32))
    assert seal.opened(seal.sealed(b"")) is None
    assert seal.opened(b"") is None
