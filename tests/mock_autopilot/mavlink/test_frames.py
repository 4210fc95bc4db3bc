"""Datagrams in, messages out, whatever stands in them."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.frames import messages_in
from tests.mock_autopilot.bench import Bench

CODEC = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)


def _ping(sequence: int) -> bytes:
    return bytes(mavlink.MAVLink_ping_message(0, sequence, 0, 0).pack(CODEC))


def _sequences(payload: bytes) -> list[int]:
    return [m.seq for m in messages_in(payload, CODEC) if m.get_type() == "PING"]


def test_several_frames_of_one_datagram_are_all_read() -> None:
    assert _sequences(_ping(1) + _ping(2)) == [1, 2]


@given(st.binary(max_size=60).filter(lambda noise: not {0xFD, 0xFE} & set(noise)))
def test_noise_around_a_frame_does_not_hide_it(noise: bytes) -> None:
    assert _sequences(noise + _ping(3) + noise) == [3]


def test_a_frame_that_was_cut_off_hides_nothing_behind_it() -> None:
    assert _sequences(_ping(4)[:9] + _ping(5)) == [5]


@pytest.mark.parametrize("at", range(1, 20))
def test_a_flipped_bit_loses_its_frame_only(at: int) -> None:
    broken = bytearray(_ping(6))
    broken[at] ^= 0x10
    assert _sequences(bytes(broken) + _ping(7))[-1] == 7
    assert 6 not in _sequences(bytes(broken))


@settings(max_examples=200)
@given(st.binary(max_size=300))
def test_no_datagram_breaks_the_link(payload: bytes) -> None:
    assert isinstance(messages_in(payload, CODEC), list)


NUMBERS = st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, 176.0, 512.0, -1.0]))


@settings(max_examples=40)
@given(st.sampled_from([20, 21, 22, 176, 185, 246, 400, 510, 511, 512, 519, 520]), st.tuples(*[NUMBERS] * 7))
def test_no_command_breaks_the_vehicle(command: int, params: tuple[float, ...]) -> None:
    bench = _bench()
    bench.hear(mavlink.MAVLink_command_long_message(1, 1, command, 0, *params))
    bench.run(0.02)


@settings(max_examples=30)
@given(st.tuples(*[st.floats(width=32)] * 8), st.integers(0, 255))
def test_no_setpoint_breaks_the_vehicle(values: tuple[float, ...], mask: int) -> None:
    bench = _bench()
    bench.arm()
    bench.hear(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, list(values[:4]), *values[4:]))
    bench.mode(6)
    bench.run(0.2)
    assert all(abs(part) <= 1.0 + 1e-9 for part in bench.world.truth.q_ned_frd_wxyz)


@settings(max_examples=30)
@given(st.tuples(*[st.floats(width=32)] * 6))
def test_no_vision_breaks_the_vehicle(values: tuple[float, ...]) -> None:
    bench = Bench({"EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 15, "EKF2_MAG_TYPE": 5})
    bench.run(0.1)
    bench.hear(mavlink.MAVLink_vision_position_estimate_message(0, *values, [float("nan")] * 21))
    bench.run(0.1)
    struct.pack("<6f", *bench.world.vehicle.estimate.position_m, *bench.world.vehicle.estimate.velocity_mps)


_READY: list[Bench] = []


def _bench() -> Bench:
    if not _READY:
        _READY.append(Bench())
        _READY[0].run(4.2)
    return _READY[0].again()
