"""Motion of one servo in simulated time: limits, balance of torques, and that position, rate and acceleration agree."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_autopilot.servos.motor import AX_12A, XM430_W210, XM430_W350, Motor, MotorSpec

STEP_S = 0.002
SPECS = [XM430_W350, XM430_W210, AX_12A]
XM_GAIN_PER_RAD = 800 / 128 / 885 / (2 * math.pi / 4096)


def motor(spec: MotorSpec = XM430_W350, angle_rad: float = 1.0) -> Motor:
    made = Motor(spec, angle_rad)
    made.gain_per_rad = XM_GAIN_PER_RAD
    made.power(on=True)
    return made


def run(one: Motor, for_s: float, load_nm: float = 0.0) -> list[tuple[float, float, float]]:
    """Angle, rate and acceleration after every step."""
    motion = []
    for _ in range(round(for_s / STEP_S)):
        one.step(STEP_S, load_nm)
        motion.append((one.angle_rad, one.rate_radps, one.accel_radps2))
    return motion


@pytest.mark.parametrize("spec", SPECS)
def test_a_servo_settles_at_its_goal_and_stays(spec: MotorSpec) -> None:
    one = motor(spec)
    one.go_to(1.8)
    run(one, 2.0)
    # Where it settles exactly is up to friction: inside the distance whose PWM does not overcome it.
    assert abs(one.angle_rad - 1.8) <= spec.friction_nm / (spec.stall_nm * one.gain_per_rad) + 1e-9
    assert (one.rate_radps, one.accel_radps2) == (0.0, 0.0)


@pytest.mark.parametrize("spec", SPECS)
def test_without_a_profile_it_is_as_fast_as_the_motor_and_no_faster(spec: MotorSpec) -> None:
    one = motor(spec, 0.0)
    one.go_to(6.0)
    fastest = max(rate for _, rate, _ in run(one, 3.0))
    in_balance = spec.no_load_radps * (1.0 - spec.friction_nm / spec.stall_nm)
    assert fastest == pytest.approx(in_balance, rel=1e-3)


@pytest.mark.parametrize("spec", SPECS)
def test_acceleration_is_what_torque_and_inertia_allow(spec: MotorSpec) -> None:
    one = motor(spec, 0.0)
    one.go_to(6.0)
    hardest = max(abs(accel) for _, _, accel in run(one, 3.0))
    assert hardest == pytest.approx((spec.stall_nm - spec.friction_nm) / spec.inertia_kgm2)


def test_less_voltage_means_less_torque_and_speed() -> None:
    one = motor(XM430_W350, 0.0)
    one.supply(6.0)
    one.go_to(6.0)
    motion = run(one, 5.0)
    spec = XM430_W350
    assert max(accel for _, _, accel in motion) == pytest.approx((spec.stall_nm / 2 - 0.05) / spec.inertia_kgm2)
    assert max(rate for _, rate, _ in motion) == pytest.approx(spec.no_load_radps / 2 * (1 - 0.1 / 4.1), rel=1e-3)


def test_it_holds_a_load_with_the_sag_of_a_proportional_loop() -> None:
    one = motor()
    run(one, 2.0, load_nm=-0.8)
    stiffness = XM430_W350.stall_nm * XM_GAIN_PER_RAD
    assert one.rate_radps == 0.0
    assert (0.8 - 0.05) / stiffness - 1e-6 <= 1.0 - one.angle_rad <= (0.8 + 0.05) / stiffness


def test_the_current_limit_is_the_torque_it_gives_way_at() -> None:
    one = motor()
    one.current_limit_nm = 1.0
    run(one, 3.0, load_nm=1.04)  # friction helps with 0.05
    assert one.rate_radps == 0.0
    run(one, 1.0, load_nm=1.2)
    assert one.rate_radps > 0.1
    assert one.torque_nm == pytest.approx(-1.0)


def test_the_pwm_limit_caps_the_torque() -> None:
    one = motor()
    one.pwm_limit = 0.25
    assert one.strength_nm == pytest.approx(4.1 / 4)
    one.go_to(6.0)
    one.step(STEP_S, 0.0)
    assert one.pwm_share == 0.25
    assert one.torque_nm == pytest.approx(4.1 / 4)


def test_a_limp_servo_keeps_its_place_under_a_small_load_and_sags_slowly_under_a_larger_one() -> None:
    one = Motor(XM430_W350, 1.0)
    run(one, 1.0, load_nm=-0.3)
    assert one.angle_rad == 1.0
    run(one, 1.0, load_nm=-0.55)
    assert one.rate_radps == pytest.approx(-(0.55 - 0.35) / 2.0, rel=1e-3)


def test_torque_off_in_motion_brakes_it_to_a_stop() -> None:
    one = motor(XM430_W350, 0.0)
    one.go_to(6.0)
    run(one, 0.5)
    one.power(on=False)
    before = one.angle_rad
    run(one, 0.5)
    assert one.rate_radps == 0.0
    assert one.angle_rad - before < 0.1


def test_a_goal_set_while_limp_is_followed_from_the_present_place_at_torque_on() -> None:
    one = Motor(XM430_W350, 1.0)
    one.gain_per_rad = XM_GAIN_PER_RAD
    one.profile_limit_radps = 1.0
    one.go_to(2.0)
    run(one, 0.5)
    assert one.angle_rad == 1.0
    one.power(on=True)
    one.step(STEP_S, 0.0)
    assert one.profile == pytest.approx((1.002, 1.0))


def test_a_rectangular_profile_moves_at_its_velocity() -> None:
    one = motor()
    one.profile_limit_radps = 0.5
    one.go_to(2.0)
    run(one, 1.0)
    assert one.profile == pytest.approx((1.5, 0.5))
    assert one.rate_radps == pytest.approx(0.5, rel=0.01)
    assert one.profile_ongoing
    run(one, 1.5)
    assert (one.profile, one.profile_ongoing) == ((2.0, 0.0), False)


def test_a_trapezoid_lasts_as_long_as_velocity_and_acceleration_make_it() -> None:
    one = motor()
    one.profile_limit_radps, one.profile_accel_radps2 = 1.0, 4.0
    one.go_to(2.0)
    steps = 0
    while one.profile_ongoing:
        one.step(STEP_S, 0.0)
        steps += 1
    assert steps * STEP_S == pytest.approx(1.0 / 1.0 + 1.0 / 4.0, abs=2 * STEP_S)


@given(
    limit=st.floats(0.5, 5.0),
    accel=st.floats(1.0, 100.0),
    goals=st.lists(st.tuples(st.floats(0.0, 6.0), st.integers(1, 200)), min_size=1, max_size=5),
)
def test_a_profile_keeps_its_limits_whatever_the_goals_and_ends_at_the_last(
    limit: float, accel: float, goals: list[tuple[float, int]]
) -> None:
    one = motor()
    one.profile_limit_radps, one.profile_accel_radps2 = limit, accel
    place, rate = one.profile
    for goal, steps in [*goals, (goals[-1][0], 2_000)]:
        one.go_to(goal)
        for _ in range(steps):
            one.step(0.02, 0.0)
            after, rate_after = one.profile
            assert abs(rate_after) <= limit + 1e-9
            assert abs(rate_after - rate) <= accel * 0.02 + 1e-9
            assert after - place == pytest.approx(rate_after * 0.02, abs=1e-9)
            place, rate = after, rate_after
            if not one.profile_ongoing:
                break
    assert one.profile == (goals[-1][0], 0.0)


@given(
    loads=st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60),
    goal=st.floats(0.0, 6.0),
    spec=st.sampled_from(SPECS),
)
def test_position_rate_and_acceleration_agree_and_stay_finite(loads: list[float], goal: float, spec: MotorSpec) -> None:
    one = motor(spec)
    one.go_to(goal)
    for load in loads:
        angle, rate = one.angle_rad, one.rate_radps
        one.step(STEP_S, load)
        assert one.rate_radps - rate == pytest.approx(one.accel_radps2 * STEP_S, abs=1e-9)
        assert one.angle_rad - angle == pytest.approx(one.rate_radps * STEP_S, abs=1e-9)
        braking = spec.stall_nm * (1.0 + abs(rate) / spec.no_load_radps) + spec.friction_nm
        assert abs(one.accel_radps2) <= (braking + abs(load)) / spec.inertia_kgm2 + 1e-6
