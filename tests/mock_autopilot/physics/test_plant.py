"""The physics: known answers, conservation, and one vehicle equals a batch of them."""

import math
from collections.abc import Callable
from dataclasses import fields, replace
from operator import itemgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mock_autopilot.physics import plant, plant_one
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics import quaternion_one as plain
from mock_autopilot.physics.plant import GRAVITY_MPS2, Actuation, PlantParams, PlantState, Wrench

Step = Callable[[PlantState, Actuation, Wrench, PlantParams, float], PlantState]
DT_S = 0.002
ROLL, YAW = 0, 2
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STILL_AIR = PlantParams(viscous_npm=(0.0,) * 3, quadratic_npm2=(0.0,) * 3, coulomb_n=(0.0,) * 3)
HIGH = np.array([0.0, 0.0, -1000.0])

small = st.floats(-1.0, 1.0)
vectors = st.tuples(small, small, small).map(np.array)


def _fly(state: PlantState, actuation: Actuation, params: PlantParams, for_s: float) -> PlantState:
    for _ in range(round(for_s / DT_S)):
        state = plant.step(state, actuation, plant.no_wrench(), params, DT_S)
    return state


def _signal(value: float, q: np.ndarray = LEVEL, on: bool = True) -> Actuation:
    return Actuation(q, np.asarray(value), motors_on=on)


def _state(tilt: np.ndarray, velocity: np.ndarray, rate: np.ndarray, thrust_n: float) -> PlantState:
    start = plant.at_rest(HIGH)
    q = quat.from_rotation_vector(tilt)
    return replace(
        start, q_ned_frd_wxyz=q, velocity_ned_mps=velocity, rate_frd_radps=rate, thrust_n=np.asarray(thrust_n)
    )


def test_without_air_and_motors_it_falls_freely() -> None:
    end = _fly(plant.at_rest(HIGH), _signal(0.0, on=False), STILL_AIR, 2.0)
    assert end.velocity_ned_mps[2] == pytest.approx(2.0 * GRAVITY_MPS2)
    assert end.position_ned_m[2] - HIGH[2] == pytest.approx(0.5 * GRAVITY_MPS2 * 4.0, rel=2e-3)


def test_half_signal_carries_the_weight() -> None:
    end = _fly(replace(plant.at_rest(HIGH), thrust_n=np.asarray(4.85 * GRAVITY_MPS2)), _signal(0.5), PlantParams(), 5.0)
    assert end.velocity_ned_mps == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_fall_ends_at_the_speed_where_drag_carries_the_weight() -> None:
    params = PlantParams()
    v = _fly(plant.at_rest(HIGH), _signal(0.0, on=False), params, 15.0).velocity_ned_mps[2]
    drag = params.viscous_npm[2] * v + params.quadratic_npm2[2] * v * v + params.coulomb_n[2]
    assert drag == pytest.approx(params.mass_kg * GRAVITY_MPS2, rel=1e-3)


def test_friction_only_takes_energy() -> None:
    params = PlantParams()
    for velocity in np.random.default_rng(3).normal(size=(200, 3)) * 5.0:
        assert plant.friction_ned_n(velocity, params.coefficients(DT_S, (3,))) @ velocity <= 0.0


@settings(max_examples=30)
@given(vectors)
def test_free_flight_keeps_its_energy(velocity: np.ndarray) -> None:
    state = _state(np.zeros(3), velocity * 5.0, np.zeros(3), 0.0)

    def energy(s: PlantState) -> float:
        return float(0.5 * s.velocity_ned_mps @ s.velocity_ned_mps - GRAVITY_MPS2 * s.position_ned_m[2])

    end = _fly(state, _signal(0.0, on=False), STILL_AIR, 0.2)
    assert energy(end) == pytest.approx(energy(state), abs=0.5 * GRAVITY_MPS2**2 * 0.2 * DT_S * 1.01)


def test_thrust_follows_with_its_lag() -> None:
    end = _fly(plant.at_rest(HIGH), _signal(1.0), PlantParams(), 0.05)
    assert float(end.thrust_n) / PlantParams().max_thrust_n == pytest.approx(1.0 - math.exp(-1.0))


@pytest.mark.parametrize("signal", [math.nan, -0.5, 0.0])
def test_no_usable_signal_is_no_thrust(signal: float) -> None:
    assert plant.thrust_of_signal(np.asarray(signal), PlantParams()) == 0.0


def test_the_motor_curve_bends_the_signal() -> None:
    curved = PlantParams(motor_curve=1.0)
    assert plant.thrust_of_signal(np.asarray(0.5), curved) == pytest.approx(0.25 * curved.max_thrust_n)


def test_it_stands_on_the_floor_until_it_is_lifted() -> None:
    standing = _fly(plant.at_rest(np.zeros(3)), _signal(0.49), PlantParams(), 1.0)
    assert bool(standing.on_ground)
    assert standing.position_ned_m == pytest.approx(np.zeros(3))
    assert not bool(_fly(standing, _signal(0.6), PlantParams(), 1.0).on_ground)


def test_it_lands_level_and_still() -> None:
    tilted = quat.from_euler(0.4, -0.2, 1.0)
    start = replace(plant.at_rest(np.array([0.0, 0.0, -0.5])), q_ned_frd_wxyz=tilted)
    end = _fly(start, _signal(0.0, on=False), PlantParams(), 1.0)
    roll, pitch, _ = quat.to_euler(end.q_ned_frd_wxyz)
    assert (roll, pitch) == (0.0, 0.0)
    assert end.velocity_ned_mps == pytest.approx(np.zeros(3))


def test_the_accelerometers_feel_the_impact_and_nothing_slides() -> None:
    before = replace(plant.at_rest(np.array([0.0, 0.0, -0.001])), velocity_ned_mps=np.array([0.8, -0.4, 0.7]))
    after = plant.step(before, _signal(0.5), plant.no_wrench(), PlantParams(), DT_S)
    assert bool(after.on_ground)
    assert before.velocity_ned_mps + after.acceleration_ned_mps2 * DT_S == pytest.approx(np.zeros(3), abs=1e-12)
    later = plant.step(after, _signal(0.3), plant.no_wrench(), PlantParams(), DT_S)
    assert later.position_ned_m[:2] == pytest.approx(before.position_ned_m[:2])
    assert later.acceleration_ned_mps2 == pytest.approx(np.zeros(3))


def test_without_motors_it_does_not_turn_by_itself() -> None:
    end = _fly(plant.at_rest(HIGH), _signal(0.0, quat.from_euler(0.5, 0.0, 0.0), on=False), PlantParams(), 0.5)
    assert end.rate_frd_radps == pytest.approx(np.zeros(3))


def test_a_roll_setpoint_rolls_right_and_moves_east() -> None:
    end = _fly(plant.at_rest(HIGH), _signal(0.5, quat.from_euler(0.2, 0.0, 0.0)), PlantParams(), 2.0)
    assert quat.to_euler(end.q_ned_frd_wxyz)[0] == pytest.approx(0.2, abs=0.01)
    assert end.velocity_ned_mps[1] > 0.5


def test_a_batch_is_what_its_members_are() -> None:
    rng = np.random.default_rng(5)
    q = quat.unit(rng.normal(size=(6, 4)))
    batch = plant.at_rest(rng.normal(size=(6, 3)) - [0.0, 0.0, 20.0])
    batch = replace(batch, velocity_ned_mps=rng.normal(size=(6, 3)))
    singles = [_member(batch, i) for i in range(6)]
    signal, force = rng.uniform(0.0, 1.0, 6), rng.normal(size=(6, 3))
    for _ in range(100):
        batch = plant.step(batch, Actuation(q, signal), Wrench(force, force), PlantParams(), DT_S)
        for i, single in enumerate(singles):
            wrench = Wrench(force[i], force[i])
            singles[i] = plant.step(single, Actuation(q[i], signal[i]), wrench, PlantParams(), DT_S)
    for i, single in enumerate(singles):
        _assert_same(_member(batch, i), single)


def _each(rng: np.random.Generator, count: int) -> PlantParams:
    """Parameters that differ from vehicle to vehicle, some of them without any lag."""
    lag_s = rng.uniform(0.01, 0.1, (count, 3))
    lag_s[0], lag_s[1, YAW] = 0.0, 0.0
    thrust_lag_s = rng.uniform(0.02, 0.1, count)
    thrust_lag_s[2] = 0.0
    return PlantParams(
        mass_kg=rng.uniform(3.0, 6.0, count),
        max_thrust_n=rng.uniform(60.0, 120.0, count),
        motor_curve=rng.uniform(0.0, 1.0, count),
        thrust_lag_s=thrust_lag_s,
        attitude_bandwidth_radps=rng.uniform(2.0, 12.0, (count, 3)),
        attitude_damping=rng.uniform(0.5, 1.2, (count, 3)),
        torque_lag_s=lag_s,
        viscous_npm=rng.uniform(0.0, 1.0, (count, 3)),
        quadratic_npm2=rng.uniform(0.0, 1.0, (count, 3)),
        coulomb_n=rng.uniform(0.0, 1.0, (count, 3)),
    )


def _of(params: PlantParams, change: Callable[[np.ndarray], np.ndarray]) -> PlantParams:
    """The same, where there are arrays with these changed."""
    arrays: dict[str, Any] = {
        item.name: change(value)
        for item in fields(PlantParams)
        if isinstance(value := getattr(params, item.name), np.ndarray)
    }
    return replace(params, **arrays)


@pytest.mark.parametrize("lead", [(5,), (1,), (2, 3)])
def test_every_vehicle_may_have_parameters_of_its_own(lead: tuple[int, ...]) -> None:
    """Against the short cut for one vehicle, through a flight that ends on the floor for some."""
    rng, count = np.random.default_rng(11), math.prod(lead)
    flat = _each(rng, max(count, 3))
    start = rng.normal(size=(count, 3)) - [0.0, 0.0, 1.5]
    q, force = quat.unit(rng.normal(size=(count, 4))), rng.normal(size=(count, 3))
    signal = rng.uniform(0.2, 0.9, count)
    shaped = _of(flat, lambda values: values[:count].reshape(*lead, *values.shape[1:]))
    batch = plant.at_rest(start.reshape(*lead, 3))
    asked = Actuation(q.reshape(*lead, 4), signal.reshape(lead))
    push = Wrench(force.reshape(*lead, 3), force.reshape(*lead, 3))
    singles = [plant.at_rest(place) for place in start]
    alone = [_of(flat, itemgetter(i)) for i in range(count)]
    for _ in range(200):
        batch = plant.step(batch, asked, push, shaped, 0.005)
        for i, single in enumerate(singles):
            wrench = Wrench(force[i], force[i])
            singles[i] = plant_one.step(single, Actuation(q[i], signal[i]), wrench, alone[i], 0.005)
    for index, single in zip(np.ndindex(lead), singles, strict=True):
        _assert_same(_member(batch, index), single)


@pytest.mark.parametrize("one", [plant.step, plant_one.step])
def test_without_a_torque_lag_the_attitude_is_a_second_order_system(one: Step) -> None:
    """Roll after a small step: 1 - exp(-z w t) (cos(d t) + z w / d sin(d t)), d = w sqrt(1 - z^2)."""
    wn, zeta, step_rad = 8.0, 0.6, 0.01
    params = PlantParams(torque_lag_s=(0.0,) * 3, attitude_bandwidth_radps=(wn,) * 3, attitude_damping=(zeta,) * 3)
    asked, state = _signal(0.5, quat.from_euler(step_rad, 0.0, 0.0)), plant.at_rest(HIGH)
    d = wn * math.sqrt(1.0 - zeta**2)
    for n in range(1, 500):
        state, t = one(state, asked, plant.no_wrench(), params, DT_S), n * DT_S
        wanted = 1.0 - math.exp(-zeta * wn * t) * (math.cos(d * t) + zeta * wn / d * math.sin(d * t))
        assert quat.to_euler(state.q_ned_frd_wxyz)[ROLL] / step_rad == pytest.approx(wanted, abs=1e-3)


def test_without_a_thrust_lag_the_thrust_is_what_is_asked() -> None:
    params = PlantParams(thrust_lag_s=0.0)
    after = plant.step(plant.at_rest(HIGH), _signal(0.7), plant.no_wrench(), params, DT_S)
    assert float(after.thrust_n) == pytest.approx(0.7 * params.max_thrust_n)


def test_a_fall_is_exact_whatever_the_step() -> None:
    state = plant.at_rest(HIGH)
    for _ in range(20):
        state = plant.step(state, _signal(0.0, on=False), plant.no_wrench(), STILL_AIR, 0.05)
    assert state.position_ned_m[2] - HIGH[2] == pytest.approx(0.5 * GRAVITY_MPS2)


def test_steps_of_five_milliseconds_fly_as_short_ones_do() -> None:
    """Open loop, a new attitude and thrust every half second: attitude within 0.1 deg, place within 1.5 cm in 5 s."""

    def flown(dt_s: float) -> list[PlantState]:
        rng, state, seen = np.random.default_rng(1), plant.at_rest(HIGH), []
        state = replace(state, thrust_n=np.asarray(4.85 * GRAVITY_MPS2))
        for _ in range(10):
            tilt, signal = rng.uniform(-0.4, 0.4, 3), 0.5 + rng.uniform(-0.1, 0.1)
            for n in range(round(0.5 / dt_s)):
                asked = _signal(signal, quat.from_euler(*tilt.tolist()))
                state = plant_one.step(state, asked, plant.no_wrench(), PlantParams(), dt_s)
                if (n + 1) * dt_s % 0.1 < 0.5 * dt_s:
                    seen.append(state)
        return seen

    for long, short in zip(flown(0.005), flown(0.001), strict=True):
        between = quat.multiply(quat.conjugate(long.q_ned_frd_wxyz), short.q_ned_frd_wxyz)
        assert np.degrees(np.abs(quat.to_rotation_vector(between)).max()) < 0.1
        assert np.abs(long.position_ned_m - short.position_ned_m).max() < 0.015


@given(st.lists(small, min_size=8, max_size=8).map(np.array), vectors)
def test_the_arrays_quaternions_are_the_plain_ones(pair: np.ndarray, turn: np.ndarray) -> None:
    a, b = (part + np.array([2.0, 0.0, 0.0, 0.0]) for part in (pair[:4], pair[4:]))
    assert quat.unit(a) == pytest.approx(np.array(plain.unit(_four(a))))
    a, b = quat.unit(a), quat.unit(b)
    assert quat.multiply(a, b) == pytest.approx(np.array(plain.multiply(_four(a), _four(b))))
    for same in (a, -a):
        assert quat.to_rotation_vector(same) == pytest.approx(np.array(plain.to_rotation_vector(_four(same))))
    after = quat.multiply(a, quat.from_rotation_vector(0.14 * turn))
    assert quat.turned_by_small(a, 0.07 * turn) == pytest.approx(after, abs=3e-8), "a half turn of 0.121 rad at most"


def _four(q: np.ndarray) -> tuple[float, float, float, float]:
    w, x, y, z = q.tolist()
    return w, x, y, z


def _member(batch: PlantState, index: int | tuple[int, ...]) -> PlantState:
    return PlantState(**{item.name: getattr(batch, item.name)[index] for item in fields(PlantState)})


def _assert_same(a: PlantState, b: PlantState) -> None:
    for item in fields(PlantState):
        left, right = getattr(a, item.name), getattr(b, item.name)
        assert np.allclose(left, right, rtol=1e-9, atol=1e-11), f"{item.name}: {left} against {right}"


@settings(max_examples=60)
@given(vectors, vectors, vectors, st.floats(0.0, 90.0), st.floats(-0.2, 1.2), vectors, st.booleans(), st.booleans())
def test_the_short_cut_for_one_vehicle_is_the_same_physics(
    tilt: np.ndarray,
    velocity: np.ndarray,
    rate: np.ndarray,
    thrust_n: float,
    signal: float,
    push: np.ndarray,
    rates: bool,
    motors_on: bool,
) -> None:
    params = PlantParams(motor_curve=0.3)
    quick = slow = _state(tilt * 3.0, velocity * 10.0, rate * 3.0, thrust_n)
    asked = Actuation(quat.from_rotation_vector(push), np.asarray(signal), rate if rates else None, motors_on)
    wrench = Wrench(push * 5.0, push)
    for _ in range(20):
        quick = plant_one.step(quick, asked, wrench, params, DT_S)
        slow = plant.step(slow, asked, wrench, params, DT_S)
    _assert_same(quick, slow)


def test_the_short_cut_lands_the_same_way() -> None:
    quick = slow = replace(plant.at_rest(np.array([1.0, 2.0, -0.3])), q_ned_frd_wxyz=quat.from_euler(0.3, 0.2, 1.0))
    for _ in range(400):
        quick = plant_one.step(quick, _signal(0.2), plant.no_wrench(), PlantParams(), DT_S)
        slow = plant.step(slow, _signal(0.2), plant.no_wrench(), PlantParams(), DT_S)
        _assert_same(quick, slow)
    assert bool(quick.on_ground)
