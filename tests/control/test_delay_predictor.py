"""The prediction against its own model, integrated here in small steps by a separately written Runge-Kutta."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control.controller import ControlInput, VehicleModel
from companion.control.delay_predictor import Predictor, PredictorMemory
from companion.core.types import Array, Reference
from companion.geometry.frames import quat_from_rotation_vector, quat_multiply, up_axis

SEED = st.integers(0, 2**32 - 1)
PERIOD_S = 0.01
G = 9.8
NOWHERE = Reference(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


def runge_kutta(rate: Callable[[float, Array], Array], x: Array, end_s: float, breaks: list[float]) -> Array:
    """Fourth order, never across a time at which the right-hand side jumps."""
    edges = sorted({0.0, end_s, *(b for b in breaks if 0.0 < b < end_s)})
    for a, b in pairwise(edges):
        h = (b - a) / 40
        for n in range(40):
            t = a + n * h
            k1 = rate(t + 1e-12, x)
            k2 = rate(t + h / 2, x + h / 2 * k1)
            k3 = rate(t + h / 2, x + h / 2 * k2)
            k4 = rate(t + h - 1e-12, x + h * k3)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def command_at(t: float, sent: list[float], known_s: float, lead_s: float) -> float:
    """The newest command acts from `known_s` - one period on, for a period and the lead; older ones a period each."""
    back = (known_s - t) / PERIOD_S  # 0..1: the newest
    if t > known_s:
        return sent[-1] if t < known_s + lead_s else 0.0
    index = math.ceil(back) if back > 0.0 else 1
    return sent[-index] if index <= len(sent) else 0.0


def breaks_of(known_s: float, lead_s: float, count: int) -> list[float]:
    return [known_s + lead_s, known_s, *(known_s - n * PERIOD_S for n in range(1, count + 1))]


def sent_before(memory: PredictorMemory) -> Array:
    """Commands oldest first, (n, 3): without the acceleration and the jerk that the memory keeps after them."""
    return memory.drives[:, :-2].T


def brute_force(now: ControlInput, memory: PredictorMemory, thrust: float, predictor: Predictor) -> tuple[Array, Array]:
    v = predictor.vehicle
    sent = np.concatenate((sent_before(memory)[1:], now.sent_accel_w_mps2[None]))
    horizon = v.mocap_age_s + v.setpoint_delay_s + float(predictor.lead_s)
    up = up_axis(now.q_w_flu_wxyz)
    step = 1e-7  # the body turns about its own axes: q then a small turn
    later = up_axis(quat_multiply(now.q_w_flu_wxyz, quat_from_rotation_vector(step * now.rate_flu_radps)))
    earlier = up_axis(quat_multiply(now.q_w_flu_wxyz, quat_from_rotation_vector(-step * now.rate_flu_radps)))
    accel = thrust * up - np.array([0.0, 0.0, G])
    jerk = thrust * (later - earlier) / (2 * step)
    w, z, tau = v.attitude_bandwidth_radps, v.attitude_damping, v.thrust_lag_s
    position, velocity = np.zeros(3), np.zeros(3)
    for axis in range(3):
        vertical = axis == 2
        known = v.mocap_age_s + (v.thrust_delay_s if vertical else v.setpoint_delay_s)
        lead = float(predictor.thrust_lead_s if vertical else predictor.lead_s)
        history = [float(row[axis]) for row in sent]

        def rate(
            t: float,
            x: Array,
            known: float = known,
            lead: float = lead,
            history: list[float] = history,
            vertical: bool = vertical,
        ) -> Array:
            u = command_at(t, history, known, lead)
            if vertical:
                return np.array([x[1], x[2], (u - x[2]) / tau, 0.0])
            return np.array([x[1], x[2], x[3], w * w * (u - x[2]) - 2 * z * w * x[3]])

        start = np.array([now.position_w_m[axis], now.velocity_w_mps[axis], accel[axis], jerk[axis]])
        end = runge_kutta(rate, start, horizon, breaks_of(known, lead, len(history)))
        position[axis], velocity[axis] = end[0], end[1]
    late = now.age_s - v.mocap_age_s
    return position + late * now.velocity_w_mps, velocity


def random_input(rng: np.random.Generator, age_s: float) -> ControlInput:
    q = quat_from_rotation_vector(rng.normal(0.0, 0.2, 3))
    p, v, rate, sent = rng.normal(size=3), rng.normal(0.0, 0.5, 3), rng.normal(0.0, 1.0, 3), rng.normal(0.0, 2.0, 3)
    return ControlInput(
        position_w_m=p,
        velocity_w_mps=v,
        q_w_flu_wxyz=q,
        rate_flu_radps=rate,
        age_s=age_s,
        reference=NOWHERE,
        sent_accel_w_mps2=sent,
        dt_s=PERIOD_S,
    )


@settings(max_examples=25)
@given(
    seed=SEED,
    lead=st.floats(0.0, 0.2),
    thrust_lead=st.floats(0.0, 0.3),
    delay=st.floats(0.0, 0.08),
    thrust_delay=st.floats(0.0, 0.05),
    age=st.floats(0.0, 0.03),
    bandwidth=st.floats(3.0, 20.0),
    damping=st.floats(0.4, 1.2),
)
def test_the_weights_are_the_models_integral(
    seed: int,
    lead: float,
    thrust_lead: float,
    delay: float,
    thrust_delay: float,
    age: float,
    bandwidth: float,
    damping: float,
) -> None:
    vehicle = VehicleModel(
        attitude_bandwidth_radps=bandwidth,
        attitude_damping=damping,
        thrust_lag_s=0.05,
        setpoint_delay_s=delay,
        thrust_delay_s=thrust_delay,
        mocap_age_s=age,
    )
    predictor = Predictor(vehicle, PERIOD_S, lead, thrust_lead)
    rng = np.random.default_rng(seed)
    now = random_input(rng, age + 0.004)
    memory = predictor.initial(now)
    memory = replace(memory, drives=rng.normal(0.0, 2.0, memory.drives.shape))
    predicted, after = predictor.step(memory, now)
    position, velocity = predicted.position_w_m, predicted.velocity_w_mps
    expected = brute_force(now, memory, float(after.thrust_mps2[0]), predictor)
    # commands older than the memory acted before the capture; only those still acting then may be missing
    known = age + max(delay, thrust_delay)
    if thrust_delay > delay and math.ceil(known / PERIOD_S) > len(sent_before(memory)):
        expected[0][2], expected[1][2] = position[2], velocity[2]
    np.testing.assert_allclose(position, expected[0], atol=1e-7)
    np.testing.assert_allclose(velocity, expected[1], atol=1e-7)


def test_with_no_delay_and_no_lead_nothing_is_changed() -> None:
    vehicle = VehicleModel(setpoint_delay_s=0.0, thrust_delay_s=0.0, mocap_age_s=0.0)
    predictor = Predictor(vehicle, PERIOD_S, 0.0, 0.0)
    now = random_input(np.random.default_rng(1), 0.0)
    predicted, _ = predictor.step(predictor.initial(now), now)
    np.testing.assert_allclose(predicted.position_w_m, now.position_w_m, atol=1e-12)
    np.testing.assert_allclose(predicted.velocity_w_mps, now.velocity_w_mps, atol=1e-12)
    assert predictor.preview_s == 0.0


def test_a_vehicle_that_hovers_is_predicted_to_hover() -> None:
    predictor = Predictor(VehicleModel(), PERIOD_S, 0.1, 0.03)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    now = ControlInput(
        position_w_m=np.array([1.0, 2.0, 3.0]),
        velocity_w_mps=np.zeros(3),
        q_w_flu_wxyz=level,
        rate_flu_radps=np.zeros(3),
        age_s=0.01,
        reference=NOWHERE,
        sent_accel_w_mps2=np.zeros(3),
        dt_s=0.01,
    )
    memory = predictor.initial(now)
    for _ in range(20):
        predicted, memory = predictor.step(memory, now)
    np.testing.assert_allclose(predicted.position_w_m, [1.0, 2.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(predicted.velocity_w_mps, np.zeros(3), atol=1e-9)


def test_an_older_frame_is_carried_on_by_its_velocity() -> None:
    predictor = Predictor(VehicleModel(mocap_age_s=0.01), PERIOD_S, 0.1, 0.03)
    rng = np.random.default_rng(2)
    fresh = random_input(rng, 0.01)
    memory = predictor.initial(fresh)
    old = ControlInput(**{**fresh.__dict__, "age_s": 0.03})
    here, _ = predictor.step(memory, fresh)
    there, _ = predictor.step(memory, old)
    np.testing.assert_allclose(there.position_w_m - here.position_w_m, 0.02 * fresh.velocity_w_mps, atol=1e-12)


@given(seed=SEED, thrust_lead=st.floats(0.05, 0.3))
def test_no_command_acts_after_the_horizon(seed: int, thrust_lead: float) -> None:
    """A lead of the thrust beyond the horizon is the lead up to it."""
    now = random_input(np.random.default_rng(seed), 0.01)
    predicted = []
    for lead in (thrust_lead, 0.04):  # horizon 0.05 s: 0.01 s of age, 0.04 s of delay; thrust known up to 0.02 s
        predictor = Predictor(VehicleModel(), PERIOD_S, 0.0, lead)
        then, _ = predictor.step(predictor.initial(now), now)
        predicted.append(np.concatenate((then.position_w_m, then.velocity_w_mps)))
    np.testing.assert_allclose(predicted[0], predicted[1], atol=1e-12)


def test_the_modelled_thrust_follows_what_was_asked_for_with_its_lag() -> None:
    predictor = Predictor(VehicleModel(thrust_lag_s=0.05), PERIOD_S, 0.1, 0.03)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    hover = ControlInput(
        position_w_m=np.zeros(3),
        velocity_w_mps=np.zeros(3),
        q_w_flu_wxyz=level,
        rate_flu_radps=np.zeros(3),
        age_s=0.01,
        reference=NOWHERE,
        sent_accel_w_mps2=np.zeros(3),
        dt_s=0.01,
    )
    memory = predictor.initial(hover)
    assert float(memory.thrust_mps2[0]) == pytest.approx(G)
    count = len(sent_before(memory))
    climb = ControlInput(**{**hover.__dict__, "sent_accel_w_mps2": np.array([0.0, 0.0, 1.0])})
    for n in range(count + 4):
        _, memory = predictor.step(memory, climb)
        cycles = max(0, n + 2 - count)  # cycles in which the step was the oldest command kept
        assert float(memory.thrust_mps2[0]) == pytest.approx(G + 1.0 - math.exp(-0.01 * cycles / 0.05), abs=1e-9)


def test_a_batch_of_leads_predicts_as_each_alone() -> None:
    rng = np.random.default_rng(5)
    leads, thrust_leads, poles = rng.uniform(0.0, 0.15, (3, 4, 1))
    many = Predictor(VehicleModel(), PERIOD_S, leads, thrust_leads, poles)
    inputs = [random_input(rng, 0.014) for _ in range(4)]
    both = [np.stack([getattr(now, name) for now in inputs]) for name in VECTORS]
    batch = ControlInput(
        position_w_m=both[0],
        velocity_w_mps=both[1],
        q_w_flu_wxyz=both[2],
        rate_flu_radps=both[3],
        age_s=0.014,
        reference=NOWHERE,
        sent_accel_w_mps2=both[4],
        dt_s=PERIOD_S,
    )
    memory = many.initial(batch)
    for _ in range(3):
        predicted, memory = many.step(memory, batch)
    for i, now in enumerate(inputs):
        one = Predictor(VehicleModel(), PERIOD_S, float(leads[i, 0]), float(thrust_leads[i, 0]), float(poles[i, 0]))
        alone_memory = one.initial(now)
        for _ in range(3):
            alone, alone_memory = one.step(alone_memory, now)
        for name in ("position_w_m", "velocity_w_mps", "disturbance_w_mps2"):
            np.testing.assert_allclose(getattr(predicted, name)[i], getattr(alone, name), atol=1e-12)


VECTORS = ("position_w_m", "velocity_w_mps", "q_w_flu_wxyz", "rate_flu_radps", "sent_accel_w_mps2")


def test_a_push_that_goes_on_is_part_of_the_prediction() -> None:
    """Hovering upright, pushed by 0.5 m/s^2 along x: after the observer has found it, it is carried to the horizon."""
    vehicle = VehicleModel(mocap_age_s=0.01, setpoint_delay_s=0.04)
    predictor = Predictor(vehicle, PERIOD_S, 0.1, 0.03, observer_radps=6.0)
    level, nothing, push = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.array([0.5, 0.0, 0.0])
    memory = predictor.initial(
        ControlInput(
            position_w_m=nothing,
            velocity_w_mps=nothing,
            q_w_flu_wxyz=level,
            rate_flu_radps=nothing,
            age_s=0.01,
            reference=NOWHERE,
            sent_accel_w_mps2=nothing,
            dt_s=PERIOD_S,
        )
    )
    for n in range(1, 301):
        t = n * PERIOD_S
        now = ControlInput(
            position_w_m=0.5 * t * t * push,
            velocity_w_mps=t * push,
            q_w_flu_wxyz=level,
            rate_flu_radps=nothing,
            age_s=0.01,
            reference=NOWHERE,
            sent_accel_w_mps2=nothing,
            dt_s=PERIOD_S,
        )
        predicted, memory = predictor.step(memory, now)
    then = 3.0 + 0.15
    np.testing.assert_allclose(predicted.disturbance_w_mps2, push, atol=1e-4)
    np.testing.assert_allclose(predicted.velocity_w_mps, then * push, atol=1e-4)
    np.testing.assert_allclose(predicted.position_w_m, 0.5 * then * then * push, atol=1e-4)
