"""Counts and SI values, and answers taken apart: against the manuals' own numbers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.adapters.dynamixel.conversion import JointScale, at_least_one
from companion.adapters.dynamixel.joint import joints_of
from companion.adapters.dynamixel.registers import MODELS, Answer, Ax, Block, Register, Xm, ax_baud
from companion.adapters.dynamixel.wire import fast_answers
from companion.config.arms_config import XM_BAUDS, ArmsConfig

XM = JointScale(MODELS["XM430-W350"], 1, math.pi)
AX = JointScale(MODELS["AX-12A"], 1, math.radians(150.0))
RPM = 2.0 * math.pi / 60.0


def xm_state(current: int = 0, velocity: int = 0, position: int = 2048, voltage: int = 120, warmth: int = 30) -> Answer:
    """Return an XM's block from Present Current (126) to Present Temperature (146)."""
    parts = ((current, 2), (velocity, 4), (position, 4), (0, 4), (0, 4), (voltage, 2), (warmth, 1))
    return Answer(126, b"".join(value.to_bytes(size, "little", signed=value < 0) for value, size in parts), 0)


def ax_state(position: int = 512, speed: int = 0, load: int = 0, voltage: int = 120, warmth: int = 30) -> Answer:
    """Return an AX's block from Torque Enable (24) to Present Temperature (43)."""
    parts = ((position, 2), (speed, 2), (load, 2), (voltage, 1), (warmth, 1))
    return Answer(24, bytes(12) + b"".join(value.to_bytes(size, "little") for value, size in parts), 0)


def test_an_xm_says_its_state_in_the_manuals_units() -> None:
    reading = XM.reading(xm_state(current=-100, velocity=200, position=1024, voltage=121, warmth=41))
    assert reading.position_rad == pytest.approx(math.radians(90.0 - 180.0))
    assert reading.velocity_radps == pytest.approx(200 * 0.229 * RPM)
    assert reading.effort == pytest.approx(-100 * 2.69e-3 / 2.3)
    assert reading.voltage_v == pytest.approx(12.1)
    assert reading.temperature_c == 41.0


def test_an_ax_says_its_state_in_the_manuals_units() -> None:
    reading = AX.reading(ax_state(position=1023, speed=300, load=512, voltage=100, warmth=85))
    assert reading.position_rad == pytest.approx(math.radians(150.0))
    assert reading.velocity_radps == pytest.approx(33.3 * RPM)
    assert reading.effort == pytest.approx(0.5, abs=0.001)
    assert reading.voltage_v == pytest.approx(10.0)
    assert reading.temperature_c == 85.0


def test_the_tenth_bit_of_an_axs_speed_and_load_is_their_direction() -> None:
    reading = AX.reading(ax_state(speed=1024 + 300, load=1024 + 1023))
    assert reading.velocity_radps == pytest.approx(-33.3 * RPM)
    assert reading.effort == pytest.approx(-1.0)
    assert AX.reading(ax_state(speed=1024)).velocity_radps == 0.0


def test_units_of_the_profile_are_the_manuals() -> None:
    assert Xm.PROFILE_VELOCITY.unit == pytest.approx(0.229 * RPM)
    assert Xm.PROFILE_ACCELERATION.unit == pytest.approx(214.577 * 2.0 * math.pi / 3600.0)
    assert Ax.MOVING_SPEED.unit == pytest.approx(0.111 * RPM)


def test_baud_codes_are_the_manuals() -> None:
    assert [ax_baud(code) for code in (1, 3, 9)] == [1e6, 5e5, 2e5]
    assert (XM_BAUDS[1], XM_BAUDS[3], XM_BAUDS[7]) == (57_600, 1_000_000, 4_500_000)


scales = st.builds(
    JointScale,
    st.sampled_from(sorted(MODELS.values(), key=lambda model: model.name)),
    st.sampled_from([1, -1]),
    st.floats(0.0, 2.0 * math.pi),
)


@given(scales, st.integers(0, 1023))
def test_every_position_comes_back_as_the_count_it_was(scale: JointScale, counts: int) -> None:
    assert scale.counts(scale.joint_rad(counts)) == counts


@given(scales, st.floats(-10.0, 10.0))
def test_a_goal_is_within_half_a_count_of_what_was_asked_or_at_the_servos_end(
    scale: JointScale, joint_rad: float
) -> None:
    counts = scale.counts(joint_rad)
    assert 0 <= counts <= scale.model.table.LAST_POSITION
    if 0 < counts < scale.model.table.LAST_POSITION:
        assert abs(scale.joint_rad(counts) - joint_rad) <= 0.5 * scale.model.table.GOAL_POSITION.unit + 1e-9


@given(st.integers(-(2**31), 2**31 - 1))
def test_signed_registers_come_back(counts: int) -> None:
    register = Register(100, 4, signed=True)
    assert Answer(96, bytes(4) + register.encoded(counts), 0).raw(register) == counts


def test_a_register_outside_the_block_is_refused() -> None:
    with pytest.raises(ValueError, match="register 132 is not in the 3 bytes from address 130"):
        Answer(130, bytes(3), 0).raw(Xm.PRESENT_POSITION)


@given(st.floats(0.0, 100.0))
def test_a_limit_is_never_written_as_no_limit(value: float) -> None:
    for register, most in ((Ax.MOVING_SPEED, 1023), (Xm.PROFILE_VELOCITY, 32_767)):
        assert 1 <= at_least_one(value, register) <= most


def test_profiles_of_all_joints_leave_room_for_their_limits() -> None:
    for joint in joints_of(ArmsConfig()):
        if joint.protocol == 1:
            speed_radps = int.from_bytes(joint.profile, "little") * 0.111 * RPM
        else:
            speed_radps = int.from_bytes(joint.profile[4:], "little") * 0.229 * RPM
            accel_radps2 = int.from_bytes(joint.profile[:4], "little") * 214.577 * 2.0 * math.pi / 3600.0
            assert accel_radps2 == pytest.approx(3.0 * joint.limit.max_accel_radps2, rel=0.02)
        assert speed_radps == pytest.approx(1.5 * joint.limit.max_velocity_radps, rel=0.02)


def test_the_manuals_example_of_a_fast_sync_read() -> None:
    """Protocol 2.0, "Fast Sync Read": Present Position of IDs 3, 7 and 4, as it follows the instruction field."""
    answers = fast_answers(
        bytes.fromhex("00 03 A6 00 00 00 84 08  00 07 1F 08 00 00 16 CA  00 04 FF 03 00 00 D1 9E"), Block(132, 136)
    )
    positions = {servo_id: int.from_bytes(answer.data, "little") for servo_id, answer in answers.items()}
    assert positions == {3: 166, 7: 2079, 4: 1023}


def test_every_servo_has_its_own_error_field_in_a_fast_answer() -> None:
    answers = fast_answers(bytes.fromhex("00 03 A6 00 00 00 84 08  80 07 1F 08 00 00 16 CA"), Block(132, 136))
    assert {servo_id: answer.error for servo_id, answer in answers.items()} == {3: 0, 7: 0x80}


def test_a_fast_answer_of_the_wrong_length_is_none() -> None:
    assert fast_answers(bytes(25), Block(132, 136)) == {}
