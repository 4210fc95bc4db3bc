"""Force and heading to attitude and thrust: a table of cases with reasons, and the properties between them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.geometry.attitude import (
    ThrustModel,
    accel_of_setpoint,
    attitude_of,
    collective_force_n,
    force_of_accel,
    limit_tilt,
    normalised_thrust,
    setpoint_of_accel,
    thrust_axis,
)
from companion.geometry.frames import euler_ned_frd_deg

MODEL = ThrustModel()  # 4.85 kg, 9.8 m/s^2, hover at 0.5
WEIGHT_N = 4.85 * 9.8
ACCEL = st.lists(st.floats(-8.0, 8.0), min_size=3, max_size=3)
YAW = st.floats(-math.pi, math.pi)


def rotation(q: Array) -> Array:
    """v' = v + 2 w (r x v) + 2 r x (r x v), column by column."""
    w, r = float(q[0]), q[1:]
    columns = [e + 2.0 * w * np.cross(r, e) + 2.0 * np.cross(r, np.cross(r, e)) for e in np.eye(3)]
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(
    ("force_w_n", "expected", "because"),
    [
        ((0, 0, 20), (0, 0, 1), "pure lift leaves the vehicle level"),
        ((0, 0, 0), (0, 0, 1), "no force has no direction: level, not NaN"),
        ((5e-4, 0, 0), (0, 0, 1), "less than a millinewton has none worth following"),
        ((20, 0, 0), (1, 0, 0), "a push along x tilts the thrust axis to x"),
        ((0, -3, 4), (0, -0.6, 0.8), "3-4-5"),
        ((0, 0, -20), (0, 0, 1), "straight down would turn the vehicle over: level"),
        ((3, 4, -20), (0.6, 0.8, 0), "of a force below the horizon only the horizontal part is followed"),
    ],
)
def test_where_the_rotors_push(force_w_n: tuple[float, ...], expected: tuple[float, ...], because: str) -> None:
    np.testing.assert_allclose(np.array(thrust_axis(*force_w_n)), np.array(expected), err_msg=because)


HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("axis", "yaw_deg", "expected", "because"),
    [
        ((0, 0, 1), 0, (1, 0, 0, 0), "level, nose along x"),
        ((0, 0, 1), 90, (HALF, 0, 0, HALF), "level, nose along y"),
        ((1, 0, 0), 0, (HALF, 0, HALF, 0), "horizontal force along the nose: a quarter turn nose down"),
        ((0, 1, 0), 0, (0.5, -0.5, -0.5, -0.5), "horizontal force to the left leaves the nose no direction: up"),
        ((0, 0, -1), 0, (0, 1, 0, 0), "inverted: half a turn about the nose's axis keeps y's line"),
    ],
)
def test_attitudes_of_an_axis_and_a_heading(
    axis: tuple[float, ...], yaw_deg: float, expected: tuple[float, ...], because: str
) -> None:
    x, y, z = axis
    q = attitude_of(x, y, z, math.radians(yaw_deg))
    assert np.all(np.isfinite(q)), because
    np.testing.assert_allclose(rotation(q)[:, 2], axis, atol=1e-9, err_msg=because)
    if axis[2] >= 0:
        np.testing.assert_allclose(abs(float(q @ np.array(expected))), 1.0, atol=1e-9, err_msg=because)


@pytest.mark.parametrize(
    ("accel", "yaw_deg", "roll", "pitch", "yaw", "because"),
    [
        ((2.0, 0, 0), 0, 0.0, -1.0, 0.0, "forward: nose down is negative pitch in FRD"),
        ((-2.0, 0, 0), 0, 0.0, 1.0, 0.0, "backward: nose up"),
        ((0, 2.0, 0), 0, -1.0, 0.0, 0.0, "left (+y of W): negative roll in FRD"),
        ((0, -2.0, 0), 0, 1.0, 0.0, 0.0, "right: positive roll"),
        ((0, 2.0, 0), 90, 0.0, -1.0, -90.0, "the nose along +y: +y is forward, and NED's yaw is -90"),
    ],
)
def test_what_the_autopilot_is_told(
    accel: tuple[float, ...], yaw_deg: float, roll: float, pitch: float, yaw: float, because: str
) -> None:
    lean_deg = math.degrees(math.atan2(2.0, 9.8))
    setpoint = setpoint_of_accel(np.array(accel, dtype=float), math.radians(yaw_deg), MODEL)
    found = euler_ned_frd_deg(setpoint.q_w_flu_wxyz)
    np.testing.assert_allclose(found, (roll * lean_deg, pitch * lean_deg, yaw), atol=1e-9, err_msg=because)


@given(accel=ACCEL, yaw=YAW)
def test_the_thrust_axis_is_along_the_force_and_the_nose_towards_the_heading(accel: list[float], yaw: float) -> None:
    setpoint = setpoint_of_accel(np.array(accel), yaw, MODEL)
    force = 4.85 * (np.array(accel) + np.array([0.0, 0.0, 9.8]))  # u_z > -9.8 here: never below the horizon
    r = rotation(setpoint.q_w_flu_wxyz)
    np.testing.assert_allclose(r[:, 2], force / math.sqrt(float(force @ force)), atol=1e-9)
    nose = r[:2, 0]
    assert float(nose @ np.array([math.cos(yaw), math.sin(yaw)])) > 0.0
    assert float(nose @ np.array([-math.sin(yaw), math.cos(yaw)])) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(r.T @ r, np.eye(3), atol=1e-12)


def test_the_force_is_mass_times_u_plus_gravity() -> None:
    np.testing.assert_allclose(force_of_accel(np.zeros(3), MODEL), [0.0, 0.0, WEIGHT_N])
    np.testing.assert_allclose(force_of_accel(np.array([1.0, -2.0, 0.2]), MODEL), [4.85, -9.7, 48.5])


@pytest.mark.parametrize("curve", [0.0, 1e-12, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("hover", [0.3, 0.5, 0.7])
def test_the_weight_takes_hover_thrust_whatever_the_curve(curve: float, hover: float) -> None:
    model = ThrustModel(hover_thrust=hover, curve=curve)
    assert float(normalised_thrust(np.asarray(WEIGHT_N), model)) == pytest.approx(hover, rel=1e-9)
    assert float(setpoint_of_accel(np.zeros(3), 0.0, model).thrust) == pytest.approx(hover, rel=1e-9)
    # full thrust: force_max = m g / (f h^2 + (1 - f) h)
    full = WEIGHT_N / (curve * hover**2 + (1.0 - curve) * hover)
    assert float(normalised_thrust(np.asarray(full), model)) == pytest.approx(1.0, rel=1e-9)


@given(curve=st.floats(0.0, 1.0), hover=st.floats(0.1, 0.9), thrust=st.floats(0.0, 1.0), more=st.floats(1e-3, 0.5))
def test_the_thrust_curve_goes_there_and_back_and_only_up(
    curve: float, hover: float, thrust: float, more: float
) -> None:
    model = ThrustModel(hover_thrust=hover, curve=curve)
    force = float(collective_force_n(np.asarray(thrust), model))
    share = force / (WEIGHT_N / (curve * hover**2 + (1.0 - curve) * hover))
    assert share == pytest.approx(curve * thrust**2 + (1.0 - curve) * thrust, abs=1e-9)
    assert float(normalised_thrust(np.asarray(force), model)) == pytest.approx(thrust, abs=1e-7)
    assert normalised_thrust(np.asarray(force + more), model) > normalised_thrust(np.asarray(force), model)


def test_there_is_no_negative_thrust() -> None:
    assert float(normalised_thrust(np.asarray(-5.0), MODEL)) == 0.0
    assert float(setpoint_of_accel(np.array([0.0, 0.0, -30.0]), 0.0, MODEL).thrust) == 0.0


@given(accel=ACCEL, yaw=YAW, curve=st.floats(0.0, 1.0))
def test_what_was_sent_is_read_back_as_the_acceleration_asked_for(accel: list[float], yaw: float, curve: float) -> None:
    model = ThrustModel(curve=curve)
    setpoint = setpoint_of_accel(np.array(accel), yaw, model)
    np.testing.assert_allclose(accel_of_setpoint(setpoint, model), accel, atol=1e-6)


def test_batches_are_their_members() -> None:
    accel = np.random.default_rng(0).uniform(-12.0, 12.0, (2, 3, 3))
    accel[0, 0] = 0.0, 0.0, -9.8
    accel[1, 1] = 0.0, 0.0, -20.0
    yaw = np.linspace(-3.0, 3.0, 6).reshape(2, 3)
    model = ThrustModel(curve=0.4)
    whole = setpoint_of_accel(accel, yaw, model)
    for index in np.ndindex(2, 3):
        one = setpoint_of_accel(accel[index], float(yaw[index]), model)
        np.testing.assert_allclose(whole.q_w_flu_wxyz[index], one.q_w_flu_wxyz, atol=1e-12)
        np.testing.assert_allclose(whole.thrust[index], one.thrust, atol=1e-12)
        back = accel_of_setpoint(whole, model)[index]
        np.testing.assert_allclose(back, accel_of_setpoint(one, model), atol=1e-12)


@given(
    across=st.tuples(st.floats(-30, 30), st.floats(-30, 30)),
    up=st.floats(-15, 15),
)
def test_what_the_tilt_forbids_is_taken_from_the_horizontal_and_never_from_the_height(
    across: tuple[float, float], up: float
) -> None:
    wanted = np.array([*across, up])
    cut = limit_tilt(wanted, 0.52, 9.8)
    assert cut[2] == wanted[2]
    assert np.hypot(cut[0], cut[1]) <= max(np.tan(0.52) * max(up + 9.8, 0.0), 0.0) + 1e-9
    assert cut[0] * across[1] == pytest.approx(cut[1] * across[0], abs=1e-6), "the direction stays"
    if np.hypot(*across) <= np.tan(0.52) * (up + 9.8):
        assert (cut == wanted).all(), "what is allowed is left alone"
