"""The messages of the law's link: what is packed comes back, and what is no message is refused."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.law_link.codec import packed, unpacked
from companion.law_link.messages import (
    MESSAGE,
    TICK_S,
    BadMessageError,
    Command,
    Kind,
    Plan,
    Pose,
    Text,
    UpMessage,
    is_number_newer,
    seconds_between,
    short_ticks,
    ticks_of,
)
from tests.law_link.strategies import MESSAGES, U32

FIXED = {Kind.BEAT, Kind.EVENT, Kind.CLOCK, Kind.REPORT, Kind.PLAN}
"""Kinds whose length is known, so that a byte more or fewer is noticed."""


@given(MESSAGES)
def test_what_is_packed_comes_back(message: MESSAGE) -> None:
    back = unpacked(packed(message))
    if isinstance(message, UpMessage) and message.pose is not None:
        assert isinstance(back, UpMessage)
        assert back.pose is not None
        assert back.pose.position_w_m == pytest.approx(message.pose.position_w_m, abs=1e-9)
        assert back.pose.yaw_rad == pytest.approx(message.pose.yaw_rad, abs=1e-9)
        assert packed(back) == packed(message)
    else:
        assert back == message


@given(MESSAGES, st.integers(1, 40))
def test_a_message_that_is_cut_is_refused(message: MESSAGE, cut: int) -> None:
    data = packed(message)
    if isinstance(message, Text):
        cut = max(cut, len(data) - 38)  # of its text any part is a text, too
    with pytest.raises(BadMessageError):
        unpacked(data[:-cut])


@given(MESSAGES, st.binary(min_size=1, max_size=60))
def test_a_message_with_more_behind_it_is_refused(message: MESSAGE, more: bytes) -> None:
    data = packed(message)
    if Kind(data[0] % 16) in FIXED:
        with pytest.raises(BadMessageError):
            unpacked(data + more)


@given(st.binary(max_size=1400))
@example(b"")
@example(bytes([Kind.PLAN]) + b"\xff" * 14)
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        message = unpacked(data)
    except BadMessageError:
        return
    if not isinstance(message, Text | Plan):
        assert packed(message)[0] == data[0]


def test_a_pose_outside_of_its_range_is_kept_at_the_end_of_it() -> None:
    message = UpMessage(
        kind=Kind.BEAT, session=1, sequence=1, stamp=0, number=0, epoch=0,
        pose=Pose(position_w_m=(40.0, -40.0, 1.0), yaw_rad=4.0),
    )  # fmt: skip
    back = unpacked(packed(message))
    assert isinstance(back, UpMessage)
    assert back.pose is not None
    assert back.pose.position_w_m == pytest.approx((32.767, -32.768, 1.0))
    assert back.pose.yaw_rad == pytest.approx(3.2767)


@given(st.floats(0.0, 1e6), st.floats(-1e5, 1e5))
def test_times_between_stamps_survive_the_wrap_of_32_bits(start_s: float, after_s: float) -> None:
    assert seconds_between(ticks_of(start_s + after_s), ticks_of(start_s)) == pytest.approx(after_s, abs=1.1 * TICK_S)


@given(U32)
def test_a_stamp_is_as_far_from_another_as_that_one_from_it(stamp: int) -> None:
    other = (stamp + 12_345) % 2**32
    assert seconds_between(other, stamp) == -seconds_between(stamp, other) == pytest.approx(1.2345)


@pytest.mark.parametrize(("time_s", "ticks"), [(-1.0, 0), (0.0, 0), (0.00016, 2), (6.5535, 65535), (7.0, 65535)])
def test_a_duration_is_kept_in_16_bits(time_s: float, ticks: int) -> None:
    assert short_ticks(time_s) == ticks


@given(st.integers(0, 65535), st.integers(1, 32767))
def test_numbers_of_commands_are_ordered_over_their_wrap(number: int, ahead: int) -> None:
    later = (number + ahead) % 65536
    assert is_number_newer(later, number)
    assert not is_number_newer(number, later)
    assert not is_number_newer(number, number)


def test_infinity_in_a_command_passes_and_is_left_to_the_guard() -> None:
    """A law that gives no number is judged where its output is used, not by losing its messages."""
    command = Command(accel_w_mps2=(math.inf, 0.0, 0.0), yaw_rad=0.0, capture_ago=0)
    message = UpMessage(kind=Kind.EVENT, session=1, sequence=1, stamp=0, number=1, epoch=1, command=command)
    assert unpacked(packed(message)) == message
