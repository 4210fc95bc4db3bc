"""The baseline against its formula, and the gravity its print leaves out."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.control.controller import ControlInput
from companion.control.gains import PidGains
from companion.control.pid import Pid, PidMemory
from companion.core.types import Array, Reference
from companion.geometry.attitude import ThrustModel, force_of_accel

LAW = Pid(PidGains())
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
VECTOR = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3)


def seen(position: Array, velocity: Array, accel_ref: Array | None = None, dt_s: float = 0.01) -> ControlInput:
    reference = Reference(np.zeros(3), np.zeros(3), np.zeros(3) if accel_ref is None else accel_ref, 0.0)
    return ControlInput(
        position_w_m=position,
        velocity_w_mps=velocity,
        q_w_flu_wxyz=LEVEL,
        rate_flu_radps=np.zeros(3),
        age_s=0.0,
        reference=reference,
        sent_accel_w_mps2=np.zeros(3),
        dt_s=dt_s,
    )


def test_at_no_error_the_force_is_the_weight() -> None:
    first = seen(np.zeros(3), np.zeros(3))
    _, out = LAW.step(LAW.initial(first), first)
    np.testing.assert_allclose(force_of_accel(out.accel_w_mps2, ThrustModel()), [0.0, 0.0, 4.85 * 9.8])


@given(position=VECTOR, velocity=VECTOR, integral=VECTOR, accel=VECTOR)
def test_the_force_is_the_papers_formula_plus_the_weight(
    position: list[float], velocity: list[float], integral: list[float], accel: list[float]
) -> None:
    memory, out = LAW.step(
        PidMemory(np.array(integral)), seen(np.array(position), np.array(velocity), np.array(accel), dt_s=0.02)
    )
    kp, ki, kd = (8.0, 8.0, 10.0), (1.5, 1.5, 8.0), (10.0, 10.0, 13.0)
    grown_n = [4.85 * integral[j] + ki[j] * position[j] * 0.02 for j in range(3)]
    expected_n = [-kp[j] * position[j] - grown_n[j] - kd[j] * velocity[j] + 4.85 * accel[j] for j in range(3)]
    expected_n[2] += 4.85 * 9.8
    np.testing.assert_allclose(4.85 * memory.integral_mps2, grown_n, atol=1e-6)
    np.testing.assert_allclose(
        force_of_accel(out.accel_w_mps2, ThrustModel()), expected_n, atol=1e-3
    )  # 5 digits in gains
    assert out.event == 1.0, "the baseline sends every cycle"


def test_the_integral_stops_at_its_limit() -> None:
    far = seen(np.array([10.0, -10.0, 0.0]), np.zeros(3))
    memory = LAW.initial(far)
    for _ in range(300):
        memory, _ = LAW.step(memory, far)
    np.testing.assert_allclose(4.85 * memory.integral_mps2, [15.0, -15.0, 0.0], rtol=1e-4)
    assert LAW.preview_s == 0.0


def test_seeded_with_a_disturbance_it_counters_it_at_once_as_far_as_its_integral_may() -> None:
    still = seen(np.zeros(3), np.zeros(3))
    known = np.array([0.7, -0.4, 5.0])
    _, out = LAW.step(LAW.initial_with(still, known), still)
    np.testing.assert_allclose(out.accel_w_mps2, [-0.7, 0.4, -LAW.gains.integral_max_mps2])
