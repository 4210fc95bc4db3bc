"""The autopilot's horizon against motion capture's: measured at one instant, filtered, bounded, given up in doubt."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control.horizon_correction import (
    HELD_S,
    SOUND_S,
    Horizon,
    HorizonInput,
    HorizonRules,
    corrected,
    correction_of,
    no_horizon,
    step,
    tilt_between,
)
from companion.core.types import Array, AttitudeThrust
from companion.geometry.array_math import absolute
from companion.geometry.frames import quat_conjugate, quat_from_rotation_vector, quat_from_yaw, quat_multiply, up_axis

DT_S = 0.01
RULES = HorizonRules()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STILL = np.zeros(3)


def turned(*vector: float) -> Array:
    return quat_from_rotation_vector(np.array(vector))


def seen(ours: Array, theirs: Array, **changes: Any) -> HorizonInput:
    return replace(
        HorizonInput(
            q_w_flu_wxyz=ours,
            rate_flu_radps=STILL,
            age_s=0.01,
            autopilot_q_w_flu_wxyz=theirs,
            autopilot_age_s=0.01,
            trusted=True,
            flying=True,
        ),
        **changes,
    )


def after(time_s: float, now: HorizonInput, begin: Horizon | None = None, rules: HorizonRules = RULES) -> Horizon:
    horizon = no_horizon() if begin is None else begin
    for _ in range(round(time_s / DT_S)):
        horizon = step(horizon, now, rules, DT_S)
    return horizon


ANGLE = st.floats(-3.0, 3.0)
SMALL = st.floats(-0.1, 0.1)
LEAN = st.floats(-0.5, 0.5)


@settings(max_examples=50, deadline=None)
@given(ANGLE, SMALL, SMALL, LEAN, LEAN)
def test_a_setpoint_turned_back_is_reached_in_truth(
    yaw: float, x: float, y: float, lean_x: float, lean_y: float
) -> None:
    """By an autopilot whose horizon is off by a turn about a horizontal axis."""
    wanted, error = quat_multiply(quat_from_yaw(yaw), turned(lean_x, lean_y, 0.0)), turned(x, y, 0.0)
    off_x, off_y = tilt_between(seen(wanted, quat_multiply(quat_conjugate(error), wanted)))
    assert math.hypot(off_x, off_y) == pytest.approx(math.hypot(x, y), abs=1e-9)
    sent = corrected(AttitudeThrust(wanted, np.array(0.5)), correction_of(Horizon(x=off_x, y=off_y), wanted))
    assert up_axis(quat_multiply(error, sent.q_w_flu_wxyz)) == pytest.approx(up_axis(wanted), abs=1e-9)


def test_headings_do_not_count() -> None:
    for yaw in (-3.0, -1.0, 0.5, 2.0):
        lean = turned(0.2, -0.1, 0.0)
        theirs = quat_multiply(quat_from_yaw(yaw), lean)
        assert tilt_between(seen(lean, theirs)) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_axes_and_signs() -> None:
    """A true roll of 0.05 that the autopilot holds for level is +x, whatever the heading; a setpoint rolls back."""
    for yaw in (0.0, 1.0, -2.5):
        ours = quat_multiply(quat_from_yaw(yaw), turned(0.05, 0.0, 0.0))
        x, y = tilt_between(seen(ours, quat_from_yaw(yaw)))
        assert (x, y) == pytest.approx((0.05, 0.0), abs=1e-9)
        turn = correction_of(Horizon(x=x, y=y), ours)
        level = AttitudeThrust(quat_from_yaw(yaw), np.array(0.5))
        back = quat_multiply(quat_conjugate(quat_from_yaw(yaw)), corrected(level, turn).q_w_flu_wxyz)
        assert back == pytest.approx(turned(-0.05, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("rate_radps", [2.0, -1.0])
def test_attitudes_of_one_instant_are_compared(rate_radps: float) -> None:
    """While the vehicle turns, an autopilot's attitude that is 30 ms older than motion capture's is as right."""
    rate = np.array([rate_radps, 0.5 * rate_radps, 0.0])
    now, before = quat_from_rotation_vector(0.1 * rate), quat_from_rotation_vector(0.07 * rate)
    off = tilt_between(seen(now, before, rate_flu_radps=rate, age_s=0.01, autopilot_age_s=0.04))
    assert off == pytest.approx((0.0, 0.0), abs=1e-9)
    assert math.hypot(*tilt_between(seen(now, before, rate_flu_radps=rate))) > 0.02


def test_a_step_goes_through_a_first_order_low_pass() -> None:
    horizon = after(2.0, seen(LEVEL, LEVEL))
    off = seen(turned(0.03, -0.02, 0.0), LEVEL)
    half = after(float(RULES.time_constant_s), off, horizon)
    assert (half.x, half.y) == pytest.approx((0.03 * (1 - math.exp(-1)), -0.02 * (1 - math.exp(-1))), abs=1e-4)
    assert after(10.0, off).off_rad == pytest.approx(math.hypot(0.03, 0.02), abs=1e-6)


def test_size_and_rate_are_bounded() -> None:
    horizon, off = no_horizon(), seen(turned(0.12, 0.0, 0.0), LEVEL)
    for _ in range(500):
        before, horizon = horizon, step(horizon, off, RULES, DT_S)
        assert math.hypot(horizon.x - before.x, horizon.y - before.y) <= RULES.rate_radps * DT_S + 1e-12
        assert math.hypot(horizon.x, horizon.y) <= RULES.cap_rad + 1e-12
    assert horizon.x == pytest.approx(RULES.cap_rad)
    assert horizon.off_rad == pytest.approx(0.12, abs=1e-3)


DOUBTS: dict[str, dict[str, Any]] = {
    "further apart than believed": {"autopilot_q_w_flu_wxyz": turned(-0.11, 0.0, 0.0)},
    "not trusted": {"trusted": False},
    "on the ground": {"flying": False},
    "no attitude of the autopilot any more": {"autopilot_age_s": 0.5},
    "none ever": {"autopilot_age_s": math.inf},
    "motion capture late": {"age_s": 0.3},
    "NaN in the autopilot's attitude": {"autopilot_q_w_flu_wxyz": np.full(4, math.nan)},
    "NaN in motion capture's attitude": {"q_w_flu_wxyz": np.full(4, math.nan)},
}


@pytest.mark.parametrize("doubt", DOUBTS)
def test_in_doubt_the_correction_fades_without_a_jump_and_comes_back(doubt: str) -> None:
    good = seen(turned(0.03, 0.0, 0.0), LEVEL)
    held = after(10.0, good)
    bad = replace(good, **DOUBTS[doubt])
    horizon = held
    for _ in range(round(1.0 / DT_S)):
        before, horizon = horizon, step(horizon, bad, RULES, DT_S)
        assert absolute(horizon.x - before.x) <= RULES.rate_radps * DT_S + 1e-12
        assert horizon.x <= 0.03 + 1e-9, "what is in doubt is not learnt into the correction"
    assert (horizon.x, horizon.y) == (0.0, 0.0)
    again = after(10.0, good, horizon)
    assert (again.x, again.y) == pytest.approx((0.03, 0.0), abs=1e-6)


def test_a_short_gap_is_bridged_and_a_doubt_is_waited_out() -> None:
    good = seen(turned(0.03, 0.0, 0.0), LEVEL)
    held = after(10.0, good)
    gone = replace(good, autopilot_age_s=math.inf)
    assert after(HELD_S - 2 * DT_S, gone, held).x == held.x
    doubted = after(1.0, replace(good, trusted=False), held)
    assert after(SOUND_S - 2 * DT_S, good, doubted).x == 0.0
    assert after(SOUND_S + 2 * DT_S, good, doubted).x > 0.0


def test_a_motion_capture_that_turns_over_never_steers_beyond_the_cap() -> None:
    """Slowly enough to pass the low pass: it follows to the cap and fades before *attitudes disagree* begins."""
    horizon = after(2.0, seen(LEVEL, LEVEL))
    for k in range(600):
        horizon = step(horizon, seen(turned(0.0005 * k, 0.0, 0.0), LEVEL), RULES, DT_S)
        assert horizon.x <= RULES.cap_rad
    assert horizon.x == 0.0


def test_switched_off_it_measures_alone() -> None:
    horizon = after(5.0, seen(turned(0.03, 0.0, 0.0), LEVEL), rules=HorizonRules(enabled=False))
    assert (horizon.x, horizon.y) == (0.0, 0.0)
    assert horizon.off_rad == pytest.approx(0.03, abs=1e-4)


def test_a_batch_is_its_vehicles() -> None:
    rng = np.random.default_rng(3)
    batch, ones = no_horizon((4,)), [no_horizon() for _ in range(4)]
    for k in range(200):
        ours = quat_from_rotation_vector(0.05 * rng.standard_normal((4, 3)))
        theirs, rate = quat_from_rotation_vector(0.05 * rng.standard_normal((4, 3))), rng.standard_normal((4, 3))
        age = rng.uniform(0.0, 0.04, 4)
        now = HorizonInput(
            q_w_flu_wxyz=ours,
            rate_flu_radps=rate,
            age_s=age,
            autopilot_q_w_flu_wxyz=theirs,
            autopilot_age_s=0.02,
            trusted=True,
            flying=True,
        )
        batch = step(batch, now, replace(RULES, apart_rad=0.16 if k % 3 else 0.05), DT_S)
        for i in range(4):
            one = HorizonInput(
                q_w_flu_wxyz=ours[i],
                rate_flu_radps=rate[i],
                age_s=float(age[i]),
                autopilot_q_w_flu_wxyz=theirs[i],
                autopilot_age_s=0.02,
                trusted=True,
                flying=True,
            )
            ones[i] = step(ones[i], one, replace(RULES, apart_rad=0.16 if k % 3 else 0.05), DT_S)
    for name in ("off_x", "off_y", "x", "y", "unseen_s", "sound_s"):
        assert getattr(batch, name) == pytest.approx([getattr(one, name) for one in ones], abs=1e-12), name
    turns = correction_of(batch, quat_from_yaw(np.array([0.0, 1.0, 2.0, 3.0])))
    assert turns[2] == pytest.approx(correction_of(ones[2], quat_from_yaw(2.0)), abs=1e-12)
