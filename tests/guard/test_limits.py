"""The last gate: both sides of every limit, densely near the edge, and everything that is no setpoint at all."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array, AttitudeThrust
from companion.guard.limits import LimitedSetpoint, Limits, limit_setpoint

LIMITS = Limits()  # 0.52 rad, 0.05 .. 0.80, 6 rad/s, 5 /s
DT_S = 0.01
TURN_RAD = 0.06
THRUST_STEP = 0.05
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
EDGES = [-1e-2, -1e-4, -1e-6, 1e-6, 1e-4, 1e-2]
SEED = st.integers(0, 2**32 - 1)
AZIMUTHS = [2.0 * math.pi * n / 24 for n in range(24)]


def leaning(tilt: float, azimuth: float, yaw: float = 0.0) -> Array:
    """Heading `yaw`, then tilted so that the thrust axis leans by `tilt` towards `azimuth`."""
    c, s = math.cos(tilt / 2), math.sin(tilt / 2)
    tilted = np.array([c, -s * math.sin(azimuth), s * math.cos(azimuth), 0.0])
    turned = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    return product(tilted, turned)


def product(a: Array, b: Array) -> Array:
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate(([w], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])))


def tilt_of(q: Array) -> float:
    """Angle of the body z axis to the vertical: its z component is 1 - 2 (x^2 + y^2)."""
    return 2.0 * math.asin(min(1.0, math.hypot(float(q[1]), float(q[2])) / math.sqrt(float(q @ q))))


def turn_between(a: Array, b: Array) -> float:
    d = float(np.linalg.norm(a - b)) if float(a @ b) >= 0.0 else float(np.linalg.norm(a + b))
    return 4.0 * math.asin(min(1.0, d / 2.0))


def setpoint(q: Array, thrust: float = 0.5) -> AttitudeThrust:
    return AttitudeThrust(np.asarray(q, dtype=float), np.asarray(thrust))


def passed(wanted: AttitudeThrust, last: AttitudeThrust, dt_s: float = DT_S) -> LimitedSetpoint:
    return limit_setpoint(wanted, last, LIMITS, dt_s)


def untouched(limited: LimitedSetpoint) -> bool:
    return not (limited.not_finite or limited.tilt_cut or limited.thrust_cut or limited.slew_cut)


# --- tilt ---


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("over", EDGES)
def test_the_tilt_is_cut_on_the_outer_side_of_the_cone_only(over: float, azimuth: float) -> None:
    near = setpoint(leaning(0.51, azimuth))
    limited = passed(setpoint(leaning(0.52 + over, azimuth)), near)
    assert bool(limited.tilt_cut) == (over > 0.0)
    assert not limited.slew_cut
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, leaning(min(0.52 + over, 0.52), azimuth), atol=1e-12)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("tilt", [0.6, 1.0, math.pi / 2, 3.0, math.pi - 1e-12])
def test_a_setpoint_far_outside_comes_in_along_the_shortest_way(tilt: float, azimuth: float) -> None:
    limited = passed(setpoint(leaning(tilt, azimuth)), setpoint(LEVEL), dt_s=10.0)
    assert limited.tilt_cut
    np.testing.assert_allclose(tilt_of(limited.setpoint.q_w_flu_wxyz), 0.52, atol=1e-9)
    if tilt < 3.1:
        np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, leaning(0.52, azimuth), atol=1e-9)


@pytest.mark.parametrize("q", [(0, 1, 0, 0), (0, 0, 1, 0), (0, math.sqrt(0.5), math.sqrt(0.5), 0)])
def test_exactly_inverted_comes_out_on_the_cone(q: tuple[float, ...]) -> None:
    limited = passed(setpoint(np.array(q, dtype=float)), setpoint(LEVEL), dt_s=10.0)
    assert limited.tilt_cut
    assert np.all(np.isfinite(limited.setpoint.q_w_flu_wxyz)), "there is no shortest way, but there must be one"
    assert tilt_of(limited.setpoint.q_w_flu_wxyz) == pytest.approx(0.52, abs=1e-9)


@pytest.mark.parametrize("yaw", [-2.0, 0.0, 3.0])
def test_tilting_along_or_across_the_nose_keeps_the_heading(yaw: float) -> None:
    for azimuth in (yaw, yaw + math.pi / 2, yaw + math.pi, yaw - math.pi / 2):
        limited = passed(setpoint(leaning(1.2, azimuth, yaw)), setpoint(leaning(0.5, azimuth, yaw)), dt_s=10.0)
        np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, leaning(0.52, azimuth, yaw), atol=1e-9)


@pytest.mark.parametrize(("wanted_tilt", "heading_deg"), [(0.6, 1.4), (0.8, 6.2), (1.0, 13.1), (1.2, 22.3)])
def test_a_cut_diagonal_lean_turns_the_heading_by_a_known_amount(wanted_tilt: float, heading_deg: float) -> None:
    """The cut is the smallest turn, about a horizontal axis; it does not know the heading.

    An attitude whose nose points along x while it leans by t towards 45 degrees is a lean with a twist psi,
    tan(psi) = (1 - cos t) / (1 + cos t). The twist stays while the lean becomes smaller.
    """

    def twist(tilt: float) -> float:
        return math.atan2(0.5 * (1.0 - math.cos(tilt)), 0.5 * (1.0 + math.cos(tilt)))

    wanted = leaning(wanted_tilt, math.pi / 4, twist(wanted_tilt))
    heading = math.degrees(
        math.atan2(2 * (wanted[0] * wanted[3] + wanted[1] * wanted[2]), 1 - 2 * (wanted[2] ** 2 + wanted[3] ** 2))
    )
    assert heading == pytest.approx(0.0, abs=1e-9)
    q = passed(setpoint(wanted), setpoint(leaning(0.5, math.pi / 4)), dt_s=10.0).setpoint.q_w_flu_wxyz
    after = math.degrees(math.atan2(2 * (q[0] * q[3] + q[1] * q[2]), 1 - 2 * (q[2] ** 2 + q[3] ** 2)))
    assert after == pytest.approx(heading_deg, abs=0.1)


@pytest.mark.parametrize("over", [-1e-9, 1e-9])
def test_a_billionth_beyond_the_cone_or_the_turn_is_cut_too(over: float) -> None:
    """The quick looks at both limits leave what is so near to the exact one."""
    edge = setpoint(leaning(0.52 + over, 0.4))
    assert bool(passed(edge, edge).tilt_cut) == (over > 0.0)
    half = 0.5 * (TURN_RAD + over)
    turned = setpoint(np.array([math.cos(half), 0.0, 0.0, math.sin(half)]))
    assert bool(passed(turned, setpoint(LEVEL)).slew_cut) == (over > 0.0)


def test_what_only_a_guard_cuts_is_not_cut_by_the_gate() -> None:
    limited = passed(setpoint(leaning(1.2, 0.4), 0.9), setpoint(LEVEL))
    for flag in (limited.age_cut, limited.fence_cut):
        assert flag.dtype == np.bool_
        assert not flag
    assert limited.failure == ""


# --- thrust ---


@pytest.mark.parametrize("over", EDGES)
def test_the_thrust_is_cut_on_the_outer_sides_only(over: float) -> None:
    top = passed(setpoint(LEVEL, 0.80 + over), setpoint(LEVEL, 0.79))
    assert bool(top.thrust_cut) == (over > 0.0)
    assert float(top.setpoint.thrust) == pytest.approx(min(0.80 + over, 0.80), abs=1e-15)
    bottom = passed(setpoint(LEVEL, 0.05 - over), setpoint(LEVEL, 0.06))
    assert bool(bottom.thrust_cut) == (over > 0.0)
    assert float(bottom.setpoint.thrust) == pytest.approx(max(0.05 - over, 0.05), abs=1e-15)


def test_exactly_on_the_thrust_limits_is_allowed() -> None:
    for thrust in (0.05, 0.80):
        assert untouched(passed(setpoint(LEVEL, thrust), setpoint(LEVEL, thrust)))


@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize("over", EDGES)
def test_the_thrusts_rate_is_cut_on_the_outer_side_only(over: float, way: float) -> None:
    limited = passed(setpoint(LEVEL, 0.5 + way * (THRUST_STEP + over)), setpoint(LEVEL, 0.5))
    assert bool(limited.slew_cut) == (over > 0.0)
    assert not limited.thrust_cut
    assert float(limited.setpoint.thrust) == pytest.approx(0.5 + way * min(THRUST_STEP + over, THRUST_STEP), abs=1e-15)


def test_from_idle_on_the_ground_the_thrust_climbs_at_its_rate_through_the_forbidden_range() -> None:
    last = setpoint(LEVEL, 0.0)
    seen = []
    for _ in range(3):
        last = passed(setpoint(LEVEL, 0.5), last, dt_s=0.002).setpoint
        seen.append(float(last.thrust))
    np.testing.assert_allclose(seen, [0.01, 0.02, 0.03])


# --- rate of turn ---


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8), (0, -0.8, 0.6)])
@pytest.mark.parametrize("over", EDGES)
def test_the_turn_is_cut_on_the_outer_side_only(over: float, axis: tuple[float, ...]) -> None:
    def turned(angle: float) -> Array:
        return np.concatenate(([math.cos(angle / 2)], math.sin(angle / 2) * np.array(axis)))

    limited = passed(setpoint(turned(TURN_RAD + over)), setpoint(LEVEL))
    assert bool(limited.slew_cut) == (over > 0.0)
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, turned(min(TURN_RAD + over, TURN_RAD)), atol=1e-12)


def test_the_other_sign_of_a_quaternion_is_no_turn() -> None:
    q = leaning(0.3, 1.0, 0.5)
    limited = passed(setpoint(-q), setpoint(q))
    assert untouched(limited)
    assert turn_between(limited.setpoint.q_w_flu_wxyz, q) < 1e-9


def test_a_wanted_attitude_is_reached_at_the_limits_rate() -> None:
    last, wanted = setpoint(LEVEL), setpoint(leaning(0.4, 0.7, 1.0))
    cycles = 0
    while turn_between(last.q_w_flu_wxyz, wanted.q_w_flu_wxyz) > 1e-9:
        last, cycles = passed(wanted, last).setpoint, cycles + 1
    assert cycles == math.ceil(turn_between(LEVEL, wanted.q_w_flu_wxyz) / TURN_RAD)


# --- what is no setpoint ---

BAD_NUMBERS = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize(("place", "number"), list(itertools.product(range(5), BAD_NUMBERS)))
def test_what_is_not_finite_is_replaced_by_what_went_out_last(place: int, number: float) -> None:
    values = [*leaning(0.2, 0.3), 0.6]
    values[place] = number
    last = setpoint(leaning(0.1, 0.2), 0.4)
    limited = passed(setpoint(np.array(values[:4]), values[4]), last)
    assert limited.not_finite
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, last.q_w_flu_wxyz, atol=1e-15)
    assert float(limited.setpoint.thrust) == 0.4


@pytest.mark.parametrize(
    ("scale", "refused"),
    [
        (0.0, True),
        (1e-200, True),
        (0.5, True),
        (0.9985, True),
        (0.9995, False),
        (1.0005, False),
        (1.0015, True),
        (2.0, True),
        (1e200, True),
    ],
)
def test_a_quaternion_that_is_no_rotation_is_refused_and_a_rounded_one_is_mended(scale: float, refused: bool) -> None:
    wanted, last = leaning(0.11, 0.2), leaning(0.1, 0.2)
    limited = passed(setpoint(scale * wanted), setpoint(last))
    assert bool(limited.not_finite) == refused
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, last if refused else wanted, atol=1e-12)


def test_one_bad_member_of_a_batch_spoils_no_other() -> None:
    q = np.array([LEVEL, LEVEL * math.nan, leaning(1.0, 0.3), LEVEL, leaning(0.5, 2.0)])
    thrust = np.array([0.5, 0.5, 0.5, 0.9, math.nan])
    last = AttitudeThrust(np.array([leaning(0.05, a) for a in range(5)]), np.full(5, 0.5))
    whole = limit_setpoint(AttitudeThrust(q, thrust), last, LIMITS, DT_S)
    for n in range(5):
        one = passed(setpoint(q[n], float(thrust[n])), setpoint(last.q_w_flu_wxyz[n]))
        np.testing.assert_allclose(whole.setpoint.q_w_flu_wxyz[n], one.setpoint.q_w_flu_wxyz, atol=1e-15)
        np.testing.assert_allclose(whole.setpoint.thrust[n], one.setpoint.thrust, atol=1e-15)
        for name in ("not_finite", "tilt_cut", "thrust_cut", "slew_cut"):
            assert getattr(whole, name)[n] == getattr(one, name), name


# --- properties ---


def anything(rng: np.random.Generator) -> AttitudeThrust:
    q = rng.normal(size=4)
    q /= math.sqrt(float(q @ q))
    if rng.random() < 0.2:
        q[rng.integers(4)] = rng.choice([math.nan, math.inf, 1e300, 0.0])
    return setpoint(q, float(rng.choice([rng.uniform(-1.0, 2.0), math.nan, math.inf, 0.5])))


@given(seed=SEED)
def test_from_an_allowed_setpoint_nothing_ever_leads_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    last = setpoint(leaning(rng.uniform(0.0, 0.52), rng.uniform(0, 6.3), rng.uniform(0, 6.3)), rng.uniform(0.05, 0.8))
    for _ in range(20):
        limited = passed(anything(rng), last)
        q, thrust = limited.setpoint.q_w_flu_wxyz, float(limited.setpoint.thrust)
        assert tilt_of(q) <= 0.52 + 1e-9
        assert abs(float(q @ q) - 1.0) < 1e-9
        assert 0.05 - 1e-12 <= thrust <= 0.80 + 1e-12
        assert abs(thrust - float(last.thrust)) <= THRUST_STEP + 1e-12
        # the cone is cut after the turn, and turning back to it may add a little: see the next test
        assert turn_between(q, last.q_w_flu_wxyz) <= TURN_RAD * 1.0001
        last = limited.setpoint


@pytest.mark.parametrize(("dt_s", "excess"), [(0.002, 1e-5), (0.01, 1e-4), (0.02, 1e-3), (0.05, 3e-3)])
def test_cutting_the_tilt_after_the_turn_costs_the_turns_limit_next_to_nothing(dt_s: float, excess: float) -> None:
    """The price of never leaving the cone; a late cycle counts as at most 5 periods, 0.05 s."""
    rng = np.random.default_rng(0)
    count = 50_000
    tilt = 0.52 * (1.0 - 1e-3 * rng.random(count))
    azimuth, yaw = rng.uniform(-math.pi, math.pi, (2, count))
    lean, twist = tilt / 2, yaw / 2  # the product that `leaning` makes, for all at once
    rim = np.stack(
        (
            np.cos(lean) * np.cos(twist),
            np.sin(lean) * (np.cos(azimuth) * np.sin(twist) - np.sin(azimuth) * np.cos(twist)),
            np.sin(lean) * (np.cos(azimuth) * np.cos(twist) + np.sin(azimuth) * np.sin(twist)),
            np.cos(lean) * np.sin(twist),
        ),
        axis=-1,
    )
    np.testing.assert_allclose(rim[7], leaning(float(tilt[7]), float(azimuth[7]), float(yaw[7])), atol=1e-12)
    q = rng.normal(size=(count, 4))
    q /= np.sqrt((q * q).sum(axis=1, keepdims=True))
    half = np.full(count, 0.5)
    out = limit_setpoint(AttitudeThrust(q, half), AttitudeThrust(rim, half), LIMITS, dt_s).setpoint.q_w_flu_wxyz
    distance = np.minimum(np.linalg.norm(out - rim, axis=1), np.linalg.norm(out + rim, axis=1))
    assert float((4.0 * np.arcsin(distance / 2.0)).max()) <= 6.0 * dt_s * (1.0 + excess)


@given(
    tilt=st.floats(0.0, 0.519),
    azimuth=st.floats(-3.2, 3.2),
    yaw=st.floats(-3.2, 3.2),
    thrust=st.floats(0.05, 0.8),
    seed=SEED,
)
def test_what_is_allowed_passes_as_it_is(tilt: float, azimuth: float, yaw: float, thrust: float, seed: int) -> None:
    q = leaning(tilt, azimuth, yaw)
    rng = np.random.default_rng(seed)
    nearby = product(q, np.concatenate(([1.0], rng.normal(0.0, 0.005, 3))))
    nearby /= math.sqrt(float(nearby @ nearby))
    near = thrust + rng.uniform(-0.04, 0.04)
    limited = passed(setpoint(q, thrust), setpoint(nearby, near))
    assert untouched(limited)
    np.testing.assert_allclose(limited.setpoint.q_w_flu_wxyz, q, atol=1e-15)
    assert float(limited.setpoint.thrust) == thrust


@given(seed=SEED)
def test_what_came_out_passes_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    last = setpoint(leaning(rng.uniform(0.0, 0.52), rng.uniform(0, 6.3)), rng.uniform(0.05, 0.8))
    once = passed(anything(rng), last).setpoint
    again = passed(once, last).setpoint
    np.testing.assert_allclose(again.q_w_flu_wxyz, once.q_w_flu_wxyz, atol=1e-5)
    np.testing.assert_allclose(again.thrust, once.thrust, atol=1e-12)
