"""The event trigger of eq. ETC-law: events, kappa, and the inequality the stability proof takes from them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.etnn import TriggerState, continuous_control, trigger_step
from companion.control.gains import EtnnGains
from companion.core.types import Array
from tests.control import by_hand

GAINS = EtnnGains()  # sigma = 0.05, delta = 0.1
SEED = st.integers(0, 2**32 - 1)
NOTHING_SENT = TriggerState(np.zeros(3), np.zeros(1), np.zeros(1))


def holding(u: list[float], kappa: float = 0.0) -> TriggerState:
    return TriggerState(np.array(u), np.array([kappa]), np.ones(1))


def test_the_first_step_is_an_event_even_when_nothing_is_asked_for() -> None:
    _, u, event = trigger_step(NOTHING_SENT, np.zeros(3), GAINS, 0.01)
    assert event == 1.0, "nothing was sent yet, so there is nothing to hold"
    np.testing.assert_array_equal(u, np.zeros(3))


def test_the_push_is_sigma_plus_kappa_over_delta() -> None:
    # 0.05 + 0.02 / 0.1 = 0.25
    u_bar = continuous_control(np.array([1.0, 2.0, 3.0]), np.array([0.4, -0.4, 0.0]), np.array([0.02]), GAINS)
    np.testing.assert_allclose(u_bar, [0.75, 2.25, 3.0])


def test_the_departures_of_the_push_by_hand() -> None:
    y2, kappa = np.array([0.04, -0.4, 0.0]), np.array([0.02])
    layered = EtnnGains(boundary_layer_mps=0.1)
    np.testing.assert_allclose(continuous_control(np.zeros(3), y2, kappa, layered), [-0.1, 0.25, 0.0])
    half = EtnnGains(switching=0.5)
    np.testing.assert_allclose(continuous_control(np.zeros(3), y2, kappa, half), [-0.125, 0.125, 0.0])


@pytest.mark.parametrize(
    ("error", "kappa", "event", "because"),
    [
        (0.0499, 0.0, 0.0, "kappa + delta (sigma - e) is still positive"),
        (0.0501, 0.0, 1.0, "e is beyond sigma and kappa is 0"),
        (0.1499, 0.01, 0.0, "kappa / delta = 0.1 widens the threshold to 0.15"),
        (0.1501, 0.01, 1.0, "e is beyond sigma + kappa / delta"),
        (-0.1501, 0.01, 1.0, "the size of e counts, not its sign"),
    ],
)
def test_an_event_comes_when_one_axis_leaves_the_threshold(
    error: float, kappa: float, event: float, because: str
) -> None:
    for axis in range(3):
        held = [0.3, -0.2, 0.1]
        u_bar = np.array(held)
        u_bar[axis] -= error
        after, u, happened = trigger_step(holding(held, kappa), u_bar, GAINS, 0.01)
        assert happened == event, because
        np.testing.assert_array_equal(u, u_bar if event else held)
        np.testing.assert_array_equal(after.held, u)


def test_kappa_follows_the_axis_with_the_most_slack() -> None:
    # errors 0.04, 0.01, 0.03: max(sigma - |e|) = 0.04; kappa' = -0.1 + 0.04
    after, _, event = trigger_step(holding([0.04, 0.01, -0.03], 0.1), np.zeros(3), GAINS, 0.01)
    assert event == 0.0
    np.testing.assert_allclose(after.kappa, [0.1 + 0.01 * (-0.1 + 0.04)])


def test_after_an_event_kappa_sees_no_error() -> None:
    # kappa' = -kappa + sigma
    after, _, event = trigger_step(holding([1.0, 0.0, 0.0], 0.02), np.zeros(3), GAINS, 0.01)
    assert event == 1.0
    np.testing.assert_allclose(after.kappa, [0.02 + 0.01 * (0.05 - 0.02)])


def test_with_nothing_to_do_kappa_settles_at_sigma() -> None:
    state = holding([0.0, 0.0, 0.0])
    for _ in range(2000):
        state, _, _ = trigger_step(state, np.zeros(3), GAINS, 0.01)
    np.testing.assert_allclose(state.kappa, [0.05], rtol=1e-6)


def test_every_cycle_switches_the_trigger_off() -> None:
    gains = EtnnGains(every_cycle=True)
    _, u, event = trigger_step(holding([0.0, 0.0, 0.0]), np.full(3, 0.001), gains, 0.01)
    assert event == 1.0
    np.testing.assert_array_equal(u, np.full(3, 0.001))


def wander(seed: int, gains: EtnnGains, dt: float, cycles: int = 150) -> list[tuple[Array, Array, Array, float]]:
    """A random walk of alpha_2 and y_2 through the trigger: (alpha_2, y_2, u, kappa used) of each cycle."""
    rng = np.random.default_rng(seed)
    alpha2, y2 = rng.normal(size=3), rng.normal(0.0, 0.2, 3)
    state, seen = NOTHING_SENT, []
    for _ in range(cycles):
        kappa = state.kappa
        u_bar = continuous_control(alpha2, y2, kappa, gains)
        state, u, _ = trigger_step(state, u_bar, gains, dt)
        seen.append((alpha2, y2, u, float(kappa[0])))
        push = gains.sigma + float(kappa[0]) / gains.delta
        assert np.all(np.abs(u - u_bar) <= push + 1e-12), "the hold error left sigma + kappa/delta without an event"
        alpha2 = alpha2 + rng.normal(0.0, 0.02, 3)
        y2 = y2 + rng.normal(0.0, 0.03, 3)
    return seen


@given(seed=SEED, sigma=st.floats(0.01, 0.5), delta=st.floats(0.02, 1.0), start=st.floats(0.0, 1.0))
def test_kappa_never_becomes_negative_in_steps_below_delta_over_one_plus_delta(
    seed: int, sigma: float, delta: float, start: float
) -> None:
    gains = EtnnGains(sigma=sigma, delta=delta, kappa_initial=start)
    dt = 0.999 * delta / (1.0 + delta)
    kappas = [kappa for *_, kappa in wander(seed, gains, dt)]
    assert min(kappas) >= 0.0
    assert max(kappas) <= max(start, sigma) + 1e-12, "kappa' <= sigma - kappa"


@given(seed=SEED, sigma=st.floats(0.01, 0.5), delta=st.floats(0.05, 1.0))
def test_the_held_input_never_adds_to_the_lyapunov_function(seed: int, sigma: float, delta: float) -> None:
    """Eq. key-ineq: y_2j (u_j - alpha_2j) = -push |y_2j| + y_2j e_j <= 0 whenever |e_j| <= push, axis by axis.

    That holds at every cycle with the printed sgn, between events too, because trigger and push use the same kappa.
    """
    for alpha2, y2, u, _ in wander(seed, EtnnGains(sigma=sigma, delta=delta), 0.01):
        assert np.all(y2 * (u - alpha2) <= 1e-12)


@given(seed=SEED, layer=st.floats(0.01, 0.5))
def test_a_boundary_layer_costs_at_most_a_quarter_of_push_times_layer(seed: int, layer: float) -> None:
    """With y/layer for sgn: |y| (push - push |y|/layer) is largest at |y| = layer/2; outside the layer it is <= 0."""
    gains = EtnnGains(boundary_layer_mps=layer)
    for alpha2, y2, u, kappa in wander(seed, gains, 0.01):
        push = gains.sigma + kappa / gains.delta
        gain = y2 * (u - alpha2)
        assert np.all(gain <= 0.25 * push * layer + 1e-12)
        assert np.all(gain[np.abs(y2) >= layer] <= 1e-12)


@given(seed=SEED)
def test_without_the_switching_term_the_inequality_is_lost_by_no_more_than_the_hold_error(seed: int) -> None:
    gains = EtnnGains(switching=0.0)
    for alpha2, y2, u, kappa in wander(seed, gains, 0.01):
        assert np.all(y2 * (u - alpha2) <= np.abs(y2) * (gains.sigma + kappa / gains.delta) + 1e-12)


def test_each_vehicle_of_a_batch_has_its_own_events() -> None:
    held = np.array(by_hand.random_vectors(3, 6, 0.05)).reshape(2, 3, 3)
    kappa = np.linspace(0.0, 0.02, 6).reshape(2, 3, 1)
    started = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0]).reshape(2, 3, 1)
    u_bar = np.array(by_hand.random_vectors(4, 6, 0.05)).reshape(2, 3, 3)
    after, u, event = trigger_step(TriggerState(held, kappa, started), u_bar, GAINS, 0.01)
    assert 0.0 < event.mean() < 1.0
    for a in range(2):
        for b in range(3):
            one = TriggerState(held[a, b], kappa[a, b], started[a, b])
            after_one, u_one, event_one = trigger_step(one, u_bar[a, b], GAINS, 0.01)
            np.testing.assert_array_equal(u[a, b], u_one)
            np.testing.assert_array_equal(event[a, b], event_one)
            np.testing.assert_array_equal(after.kappa[a, b], after_one.kappa)
