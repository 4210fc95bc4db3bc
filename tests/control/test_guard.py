"""The guard: what it lets through to the last bit, what age and fence make of the rest, and that nothing breaks it."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.attitude import ThrustModel, accel_of_setpoint, setpoint_of_accel
from companion.control.fence import Fence
from companion.control.guard import Guard
from companion.control.limits import Gated, Limits, gate
from companion.types import Array, AttitudeThrust, VehicleState

LIMITS, MODEL = Limits(), ThrustModel()
FENCE = Fence((-4.5, -4.5), (4.5, 4.5, 3.5))
GUARD = Guard(LIMITS, MODEL, FENCE, coast_s=0.05, degraded_s=0.10)
DT_S = 0.01
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
SINKING = 0.97 * 0.5


def asking(*accel_w_mps2: float, yaw_rad: float = 0.0) -> AttitudeThrust:
    return setpoint_of_accel(np.array(accel_w_mps2), yaw_rad, MODEL)


HOVER = asking(0.0, 0.0, 0.0)


def at(position: tuple[float, ...], velocity: tuple[float, ...] = (0.0, 0.0, 0.0), q: Array = LEVEL) -> VehicleState:
    return VehicleState(0.0, np.array(position), np.array(velocity), q, np.zeros(3))


MIDDLE = at((0.0, 0.0, 1.5))


def accel(gated: Gated) -> list[float]:
    return [float(a) for a in accel_of_setpoint(gated.setpoint, MODEL)]


def checked(
    wanted: AttitudeThrust,
    vehicle: VehicleState | None,
    age_s: float = 0.01,
    last: AttitudeThrust | None = None,
    dt_s: float = 10.0,
) -> Gated:
    """With time enough to get to whatever is wanted, unless the test says otherwise."""
    gated = GUARD.check(wanted, HOVER if last is None else last, vehicle, age_s, dt_s)
    assert not gated.failure
    return gated


def same(a: AttitudeThrust, b: AttitudeThrust) -> bool:
    return a.q_w_flu_wxyz.tolist() == b.q_w_flu_wxyz.tolist() and float(a.thrust) == float(b.thrust)


@given(
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
    z=st.floats(0.0, 2.0),
    yaw_rad=st.floats(-3.0, 3.0),
    age=st.floats(-0.05, 0.05),
)
def test_what_is_legal_goes_through_the_gate_alone(x: float, y: float, z: float, yaw_rad: float, age: float) -> None:
    wanted, last = asking(0.1 * x, -0.1 * y, 0.5, yaw_rad=yaw_rad), asking(0.0, 0.1, 0.2, yaw_rad=yaw_rad - 0.01)
    gated = checked(wanted, at((x, y, z), (0.5, -0.5, 0.2)), age, last, DT_S)
    bare = gate(wanted, last, LIMITS, DT_S)
    assert same(gated.setpoint, bare.setpoint)
    assert not gated.fence_cut
    assert not gated.age_cut


def test_towards_the_wall_is_braked_and_the_other_axes_keep_what_they_want() -> None:
    gated = checked(asking(3.0, 1.0, 0.5), at((4.0, 0.0, 1.5), (1.5, 0.0, 0.0)))
    assert gated.fence_cut
    x, y, z = accel(gated)
    assert x < -2.0
    assert (y, z) == pytest.approx((1.0, 0.5), abs=1e-9)


@pytest.mark.parametrize(
    ("age_s", "share"), [(0.05, 1.0), (0.06, 0.8), (0.075, 0.5), (0.0999, 0.002), (0.1, 0.0), (9.0, 0.0)]
)
def test_with_age_the_cone_shrinks_and_the_thrust_is_drawn_to_just_below_hover(age_s: float, share: float) -> None:
    wanted = AttitudeThrust(asking(5.6, 0.0, 0.0).q_w_flu_wxyz, np.array(0.7))
    gated = checked(wanted, MIDDLE, age_s)
    assert bool(gated.age_cut) == (share < 1.0)
    q = gated.setpoint.q_w_flu_wxyz
    assert 2.0 * math.asin(math.hypot(q[1], q[2])) == pytest.approx(min(math.atan2(5.6, 9.8), share * 0.52), abs=1e-9)
    assert float(gated.setpoint.thrust) == pytest.approx(share * 0.7 + (1.0 - share) * SINKING)


ANYTHING: Any = st.one_of(st.floats(-2.0, 2.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e200, 0.0]))


@given(
    q=st.lists(ANYTHING, min_size=4, max_size=4),
    thrust=ANYTHING,
    state=st.lists(ANYTHING, min_size=10, max_size=10),
    age=ANYTHING,
    dt=ANYTHING,
)
def test_whatever_comes_in_what_goes_out_can_be_flown(
    q: list[float], thrust: float, state: list[float], age: float, dt: float
) -> None:
    vehicle = VehicleState(0.0, np.array(state[:3]), np.array(state[3:6]), np.array(state[6:]), np.zeros(3))
    wanted = AttitudeThrust(np.array(q), np.array(thrust))
    for seen in (vehicle, None):
        with np.errstate(all="ignore"):
            gated = GUARD.check(wanted, HOVER, seen, age, dt)
        out = gated.setpoint.q_w_flu_wxyz
        assert abs(float(out @ out) - 1.0) < 1e-9
        assert 2.0 * math.asin(min(1.0, math.hypot(float(out[1]), float(out[2])))) <= 0.52 + 1e-9
        assert 0.05 <= float(gated.setpoint.thrust) <= 0.8
        assert not gated.failure
