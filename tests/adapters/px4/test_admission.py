"""Tests of the choice of the accepted sender. Pure."""

import math

import pytest
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common as v2

from companion.adapters.px4.sender_lock import Admission, Sender, sender_of

OURS, OTHER, THIRD = ("10.0.0.5", 14550), ("10.0.0.6", 14550), ("10.0.0.7", 1)
PX4, INVALID = 12, 8


def heartbeat(system: int = 1, component: int = 1, autopilot: int = PX4) -> bytes:
    message = v2.MAVLink_heartbeat_message(2, autopilot, 81, 0, 4, 3)
    return bytes(message.pack(v2.MAVLink(None, srcSystem=system, srcComponent=component)))


def attitude(system: int = 1) -> bytes:
    message = v2.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 0, 0, 0)
    return bytes(message.pack(v2.MAVLink(None, srcSystem=system, srcComponent=1)))


def test_the_head_of_a_frame_of_either_version() -> None:
    assert sender_of(heartbeat(7, 154, INVALID)) == Sender(7, 154, INVALID)
    assert sender_of(attitude(3)) == Sender(3, 1, None)
    old = v1.MAVLink_heartbeat_message(2, PX4, 81, 0, 4, 3).pack(v1.MAVLink(None, srcSystem=9, srcComponent=1))
    assert sender_of(bytes(old)) == Sender(9, 1, PX4)


@pytest.mark.parametrize("datagram", [b"", b"\xfd", b"\xfe\x09\x00", b"hello", heartbeat()[:10]])
def test_what_is_no_mavlink_comes_from_nobody(datagram: bytes) -> None:
    assert sender_of(datagram) is None


def test_the_first_autopilot_is_listened_to_and_the_second_is_a_stranger() -> None:
    door = Admission(None)
    assert door.hear(OURS, attitude(), 100.0, -math.inf)
    assert not door.hear(OTHER, heartbeat(), 100.1, 100.0)
    assert door.accepted == OURS
    assert door.other_autopilots(101.0) == {OTHER: (1, "PX4")}
    assert door.other_autopilots(106.0) == {}


@pytest.mark.parametrize(
    "datagram",
    [heartbeat(component=154, autopilot=INVALID), heartbeat(255, 190, INVALID), heartbeat(autopilot=INVALID)],
)
def test_a_gimbal_or_a_ground_station_is_neither(datagram: bytes) -> None:
    door = Admission(None)
    assert not door.hear(OTHER, datagram, 100.0, -math.inf)
    assert door.other_autopilots(100.0) == {}


def test_only_the_configured_number_is_listened_to() -> None:
    door = Admission(1)
    assert not door.hear(OTHER, heartbeat(2, autopilot=3), 100.0, -math.inf)
    assert not door.hear(OTHER, attitude(2), 100.0, -math.inf)
    assert door.hear(OURS, attitude(1), 101.0, -math.inf)
    assert door.other_autopilots(101.0) == {OTHER: (2, "ArduPilot")}


def test_another_address_is_taken_when_the_autopilot_is_silent_and_not_before() -> None:
    door = Admission(1)
    assert door.hear(OURS, heartbeat(), 100.0, -math.inf)
    assert not door.hear(OTHER, heartbeat(), 103.0, 100.0)
    assert not door.hear(OTHER, heartbeat(), 200.0, 197.1)
    assert not door.hear(OTHER, heartbeat(2), 201.0, 197.1)
    assert door.hear(OTHER, heartbeat(), 201.0, 197.1)
    assert door.accepted == OTHER
    assert not door.hear(OURS, heartbeat(), 201.1, 197.1), "the new one has its time"


def test_a_broadcast_of_the_accepted_one_is_no_stranger() -> None:
    door = Admission(None)
    assert door.hear(OURS, heartbeat(), 100.0, -math.inf)
    assert not door.hear(OURS, heartbeat(), 110.0, -math.inf)
    assert door.other_autopilots(110.0) == {}
