"""The servos in simulated time, without a port: registers that move them, and their own protection."""

import math

import numpy as np
import pytest

from mock_autopilot.servos.config import DynamixelConfig, ServoConfig
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.packets import Error1
from mock_autopilot.servos.rack import ServoRack
from mock_autopilot.servos.servo import Servo
from tests.mock_autopilot.servos.servo_rig import AX, CONFIG, STEP_S, XM, pings, read, run, write


@pytest.fixture
def rack() -> ServoRack:
    return ServoRack(CONFIG)


@pytest.fixture
def xm(rack: ServoRack) -> Servo:
    return rack.servo(XM)


@pytest.fixture
def ax(rack: ServoRack) -> Servo:
    return rack.servo(AX)


def test_servos_stand_in_their_centre_at_boot_without_torque(rack: ServoRack, xm: Servo, ax: Servo) -> None:
    run(rack, 0.1)
    assert (read(xm, "present_position"), read(ax, "present_position")) == (2048, 512)
    assert not xm.torque_on
    assert not ax.torque_on
    angles, rates, accels = rack.motion()
    assert angles == pytest.approx((math.pi, math.radians(300) * 512 / 1023))
    assert rates == accels == (0.0, 0.0)


def test_the_motion_has_the_angles(rack: ServoRack, xm: Servo) -> None:
    write(xm, "torque_enable", 1)
    write(xm, "goal_position", 3000)
    run(rack, 0.1)
    np.testing.assert_array_equal(rack.motion()[0], rack.positions_rad)
    assert rack.motion()[1][0] > 0.0


def test_a_load_for_the_wrong_number_of_servos_is_refused(rack: ServoRack) -> None:
    with pytest.raises(ValueError, match="shorter"):
        rack.step(STEP_S, (0.0,))


def test_an_xm_ignores_goals_without_torque_and_follows_them_with(rack: ServoRack, xm: Servo) -> None:
    write(xm, "goal_position", 2500)
    run(rack, 0.5)
    assert read(xm, "present_position") == 2048
    write(xm, "torque_enable", 1)
    run(rack, 1.0)
    assert read(xm, "present_position") == pytest.approx(2500, abs=3)


def test_an_ax_switches_its_torque_on_with_a_goal(rack: ServoRack, ax: Servo) -> None:
    write(ax, "goal_position", 700)
    assert ax.torque_on
    run(rack, 1.0)
    assert read(ax, "present_position") == pytest.approx(700, abs=4)


def test_profile_velocity_of_an_xm_is_in_units_of_0_229_rpm(rack: ServoRack, xm: Servo) -> None:
    write(xm, "profile_velocity", 50)
    write(xm, "torque_enable", 1)
    write(xm, "goal_position", 4000)
    run(rack, 1.0)
    assert xm.motor.rate_radps == pytest.approx(50 * 0.229 * 2 * math.pi / 60, rel=0.01)
    assert read(xm, "present_velocity") == 50
    assert read(xm, "velocity_trajectory") == 50
    assert (read(xm, "moving"), read(xm, "moving_status") & 0x32) == (1, 0x12)


def test_profile_acceleration_of_an_xm_is_in_units_of_214_577_rev_per_min2(rack: ServoRack, xm: Servo) -> None:
    write(xm, "profile_velocity", 100)
    write(xm, "profile_acceleration", 10)
    write(xm, "torque_enable", 1)
    write(xm, "goal_position", 4000)
    run(rack, 0.2)
    assert xm.motor.profile[1] == pytest.approx(0.2 * 2145.77 * 2 * math.pi / 3600)
    assert read(xm, "moving_status") & 0x30 == 0x30


def test_moving_speed_of_an_ax_is_in_units_of_0_111_rpm(rack: ServoRack, ax: Servo) -> None:
    write(ax, "moving_speed", 100)
    write(ax, "goal_position", 100)
    run(rack, 0.5)
    assert ax.motor.rate_radps == pytest.approx(-11.1 * 2 * math.pi / 60, rel=0.01)
    assert (read(ax, "present_speed"), read(ax, "moving")) == (1024 + 100, 1)


def test_an_xm_shows_the_current_that_its_load_takes(rack: ServoRack, xm: Servo) -> None:
    write(xm, "torque_enable", 1)
    run(rack, 1.0, load_nm=(-0.9, 0.0))
    amps = 2.69e-3 * read(xm, "present_current")
    assert amps == pytest.approx(0.9 / 4.1 * 2.3, abs=0.05 / 4.1 * 2.3 + 2.69e-3)
    assert read(xm, "present_pwm") == pytest.approx(0.9 / 4.1 * 885, abs=0.05 / 4.1 * 885 + 1)


def test_an_ax_shows_its_load_with_its_direction(rack: ServoRack, ax: Servo) -> None:
    write(ax, "torque_enable", 1)
    run(rack, 0.9, load_nm=(0.0, 0.5))
    load = read(ax, "present_load")
    assert load > 1024
    assert load - 1024 == pytest.approx(0.5 / 1.5 * 1023, abs=0.03 / 1.5 * 1023 + 1)


def test_goal_current_limits_the_torque_in_mode_5_only() -> None:
    for mode, limit_nm in ((3, 1193 * 2.69e-3 * 4.1 / 2.3), (5, 100 * 2.69e-3 * 4.1 / 2.3)):
        rack = ServoRack(DynamixelConfig(servos=(ServoConfig(id=1, operating_mode=mode),)))
        write(rack.servo(1), "goal_current", 100)
        assert rack.servo(1).motor.current_limit_nm == pytest.approx(limit_nm)


def test_a_mode_without_position_control_does_not_move() -> None:
    rack = ServoRack(DynamixelConfig(servos=(ServoConfig(id=1, operating_mode=1),)))
    write(rack.servo(1), "torque_enable", 1)
    write(rack.servo(1), "goal_position", 3000)
    for _ in range(100):
        rack.step(STEP_S)
    assert read(rack.servo(1), "present_position") == 2048


def test_homing_offset_shifts_goals_and_positions_alike(rack: ServoRack, xm: Servo) -> None:
    write(xm, "homing_offset", 100)
    assert read(xm, "present_position") == 2148
    write(xm, "torque_enable", 1)
    write(xm, "goal_position", 2348)
    run(rack, 1.0)
    assert read(xm, "present_position") == pytest.approx(2348, abs=3)
    assert rack.positions_rad[0] == pytest.approx(2248 * 2 * math.pi / 4096, abs=0.005)


def test_work_warms_a_servo_and_rest_cools_it(rack: ServoRack, xm: Servo) -> None:
    cold = read(xm, "present_temperature")
    write(xm, "torque_enable", 1)
    run(rack, 0.5, load_nm=(-1.6, 0.0))
    for _ in range(60):
        xm.motor.heat_nm2s = 1.6**2 * 10.0  # ten seconds of it at once
        xm.tend(10.0, rack.time_s)
    share = (1.6 / 4.1) ** 2
    steady = 30.0 + 9.0 * share * 2.3 * 12.0
    assert xm.temperature_c == pytest.approx(steady, abs=(steady - 30.0) * math.exp(-2.0) * 1.1)
    warm = xm.temperature_c
    assert warm > cold + 20
    for _ in range(200):
        xm.tend(10.0, rack.time_s)
    assert xm.temperature_c == pytest.approx(30.0, abs=0.2)


def test_an_overload_takes_a_second_and_is_latched_by_an_xm_until_it_restarts(rack: ServoRack, xm: Servo) -> None:
    write(xm, "torque_enable", 1)
    run(rack, 0.8, load_nm=(-6.0, 0.0))
    assert (xm.torque_on, read(xm, "hardware_error_status")) == (True, 0)
    run(rack, 0.5, load_nm=(-6.0, 0.0))
    assert (xm.torque_on, read(xm, "hardware_error_status")) == (False, 0x20)
    run(rack, 2.0)
    assert write(xm, "torque_enable", 1) is Refusal.SHUT_DOWN
    assert read(xm, "hardware_error_status") == 0x20
    xm.restart(rack.time_s)
    assert (write(xm, "torque_enable", 1), read(xm, "hardware_error_status")) == (None, 0)


def test_an_overloaded_ax_gives_way_until_its_torque_limit_is_written_again(rack: ServoRack, ax: Servo) -> None:
    write(ax, "torque_enable", 1)
    run(rack, 1.3, load_nm=(0.0, -2.0))
    assert (ax.error, read(ax, "torque_limit"), ax.torque_on) == (Error1.OVERLOAD, 0, True)
    run(rack, 1.0)
    assert ax.error == Error1.OVERLOAD
    write(ax, "goal_position", 512)
    run(rack, 0.5)
    assert read(ax, "present_position") < 500
    write(ax, "torque_limit", 1023)
    run(rack, 1.0)
    assert ax.error == 0
    assert read(ax, "present_position") == pytest.approx(512, abs=4)


def test_a_moving_arm_is_no_overload(rack: ServoRack, xm: Servo, ax: Servo) -> None:
    write(xm, "torque_enable", 1)
    for goal in (1000, 3000, 1000, 3000):
        write(xm, "goal_position", goal)
        write(ax, "goal_position", goal // 4)
        run(rack, 0.9, load_nm=(0.8, 0.2))
    assert (read(xm, "hardware_error_status"), ax.error) == (0, 0)


def test_the_bus_watchdog_stops_an_xm_that_hears_nothing(rack: ServoRack, xm: Servo) -> None:
    write(xm, "profile_velocity", 50)
    write(xm, "torque_enable", 1)
    write(xm, "bus_watchdog", 5)
    write(xm, "goal_position", 4000)
    assert pings(rack, XM) == 1
    run(rack, 0.09)
    assert read(xm, "bus_watchdog") == 5
    run(rack, 0.5)
    assert (read(xm, "bus_watchdog"), read(xm, "present_velocity"), xm.torque_on) == (-1, 0, True)
    assert read(xm, "present_position") < 2200
    assert write(xm, "goal_position", 4000) is Refusal.OUT_OF_RANGE
    assert write(xm, "bus_watchdog", 0) is None
    assert write(xm, "goal_position", 4000) is None
