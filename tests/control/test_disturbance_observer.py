"""The observer of what pushes, against its own poles and against what it must not learn."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.control.disturbance_observer import Poles, nothing_observed, observe

DT_S = 0.01
NOTHING = np.zeros(3)


@given(push=st.integers(-3000, 3000).map(lambda thousandths: 1e-3 * thousandths), poles=st.floats(1.0, 10.0))
def test_a_step_is_learnt_with_the_double_pole(push: float, poles: float) -> None:
    """d_hat / d = 1 - (1 + w t) e^-wt in continuous time; steps of 10 ms are a little behind."""
    observed = nothing_observed(NOTHING, 0.0)
    for n in range(1, 101):
        observed = observe(observed, np.full(3, push * n * DT_S), NOTHING, 0.0, DT_S, Poles(poles))
        turn = poles * n * DT_S
        wanted = push * (1.0 - (1.0 + turn) * math.exp(-turn))
        assert abs(observed.disturbance[0] - wanted) <= 0.08 * abs(push) * max(1.0, poles / 5.0)


def test_what_the_rotors_explain_is_no_push() -> None:
    observed, accel, velocity = nothing_observed(NOTHING, 0.0), NOTHING, NOTHING
    for n in range(1, 200):
        before, accel = accel, np.array([math.sin(0.05 * n), 0.3, -0.2])
        velocity = velocity + 0.5 * DT_S * (before + accel)
        observed = observe(observed, velocity, accel, 0.0, DT_S, Poles(5.0))
        assert np.abs(observed.disturbance).max() < 0.05  # the first step's half


def test_a_state_that_only_grows_older_teaches_nothing() -> None:
    observed = observe(nothing_observed(NOTHING, 0.01), np.full(3, 0.1), NOTHING, 0.01, DT_S, Poles(5.0))
    waiting = observed
    for n in range(1, 8):
        waiting = observe(waiting, np.full(3, 0.1), NOTHING, 0.01 + n * DT_S, DT_S, Poles(5.0))
        np.testing.assert_allclose(waiting.disturbance, observed.disturbance, atol=1e-12)
    # the next frame, 80 ms after the last, has moved on as the push says: nothing more to learn
    after = observe(waiting, waiting.velocity + 0.08 * waiting.disturbance, NOTHING, 0.01, DT_S, Poles(5.0))
    np.testing.assert_allclose(after.disturbance, waiting.disturbance, atol=1e-12)


def test_no_poles_no_push() -> None:
    observed = nothing_observed(NOTHING, 0.0)
    for n in range(50):
        observed = observe(observed, np.full(3, 0.3 * n), NOTHING, 0.0, DT_S, Poles(0.0))
    np.testing.assert_array_equal(observed.disturbance, NOTHING)


@given(rate=st.floats(-0.5, 0.5), poles=st.floats(4.0, 10.0), trend=st.sampled_from([0.0, 0.25, 1.0]))
def test_a_push_that_changes_is_followed_with_its_rate_by_the_third_pole_alone(
    rate: float, poles: float, trend: float
) -> None:
    observed = nothing_observed(NOTHING, 0.0)
    for n in range(1, 1501):
        time_s = n * DT_S
        observed = observe(observed, np.full(3, 0.5 * rate * time_s**2), NOTHING, 0.0, DT_S, Poles(poles, trend))
    behind = 0.0 if trend else 2.0 * rate / poles
    np.testing.assert_allclose(rate * 15.0 - observed.disturbance, behind, atol=0.12 * abs(rate) + 1e-9)
    np.testing.assert_allclose(observed.rate, rate if trend else 0.0, atol=0.02 * abs(rate) + 1e-9)
