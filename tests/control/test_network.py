"""The network against loops over the paper's indices, and the projection against what it promises."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.gains import EtnnGains
from companion.control.network import (
    NetworkState,
    bounded_step,
    hidden_layer,
    initial_network,
    network_step,
    output,
    project,
)
from companion.core.types import Array
from tests.control import by_hand

GAINS = EtnnGains()
SEED = st.integers(0, 2**32 - 1)
GAMMA = np.array([1.0, 2.0, 3.0, 4.0])
BOUND, BAND = 2.0, 0.1


def random_state(seed: int, size: float = 1.0, hidden: int = 4) -> NetworkState:
    rng = np.random.default_rng(seed)
    return NetworkState(rng.normal(0.0, size, (4, hidden)), rng.normal(0.0, size, (hidden + 1, 3)))


def matrix_of_size(seed: int, size: float) -> Array:
    w = np.random.default_rng(seed).normal(size=(4, 3))
    return np.asarray(w * size / math.sqrt(float((w * w).sum())))


def frobenius(w: Array) -> float:
    return math.sqrt(sum(float(x) ** 2 for x in w.ravel()))


def test_the_output_by_hand() -> None:
    v0 = np.zeros((4, 4))
    v0[3, 0] = math.log(3.0)  # bias of the first neuron: sigmoid(ln 3) = 3/4; the others sit at 1/2
    v1 = np.zeros((5, 3))
    v1[0], v1[1], v1[4] = [4.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -1.0]
    x_d, phi = hidden_layer(NetworkState(v0, v1), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(x_d, [0.1, 0.2, 0.3, 1.0])
    np.testing.assert_allclose(phi, [0.75, 0.5, 0.5, 0.5, 1.0])
    np.testing.assert_allclose(output(NetworkState(v0, v1), phi), [3.0, 1.0, -1.0])


def test_the_first_output_is_zero_and_the_neurons_differ() -> None:
    state = initial_network(GAINS)
    assert state.v0.shape == (4, 4), "V_0 is (N_0 + 1) x N_1"
    assert state.v1.shape == (5, 3), "V_1 is (N_1 + 1) x N_2"
    _, phi = hidden_layer(state, np.array([0.3, -0.2, 0.1]))
    np.testing.assert_array_equal(output(state, phi), [0.0, 0.0, 0.0])
    assert len({round(float(x), 6) for x in phi[:-1]}) == 4, "equal neurons would learn the same for ever"


def test_the_start_of_the_weights_is_the_seeds() -> None:
    np.testing.assert_array_equal(initial_network(GAINS).v0, initial_network(EtnnGains()).v0)
    assert np.any(initial_network(EtnnGains(network_seed=1)).v0 != initial_network(GAINS).v0)


def test_the_gradient_of_the_activations_has_a_row_for_the_bias() -> None:
    """phi' is (N_1 + 1) x N_1, as the paper says; checked against differences of the code's own phi."""
    inner = np.array([0.3, -1.0, 0.0, 2.0])
    v0 = np.concatenate((np.zeros((3, 4)), inner[None]), axis=0)
    _, phi = hidden_layer(NetworkState(v0, np.zeros((5, 3))), np.zeros(3))
    slope = by_hand.slope_matrix(list(phi))
    assert (len(slope), len(slope[0])) == (5, 4)
    for m in range(4):
        moved = v0.copy()
        moved[3, m] += 1e-6
        _, there = hidden_layer(NetworkState(moved, np.zeros((5, 3))), np.zeros(3))
        np.testing.assert_allclose((there - phi) / 1e-6, [slope[n][m] for n in range(5)], atol=1e-6)


@given(seed=SEED, hidden=st.integers(1, 8))
def test_both_update_laws_are_the_papers_indices(seed: int, hidden: int) -> None:
    rng = np.random.default_rng(seed)
    gamma0, gamma1 = rng.uniform(0.1, 100.0, 4), rng.uniform(0.1, 100.0, hidden + 1)
    gains = EtnnGains(hidden=hidden, gamma_v0=gamma0, gamma_v1=gamma1, v0_max=1e6, v1_max=1e6)
    state = random_state(seed, hidden=hidden)
    v_d, y2 = rng.normal(size=3), rng.normal(size=3)
    x_d, phi = hidden_layer(state, v_d)
    np.testing.assert_allclose(phi, by_hand.activations(state.v0.tolist(), [*v_d, 1.0]), rtol=1e-12)
    expected = by_hand.network_output(state.v1.tolist(), phi.tolist())
    np.testing.assert_allclose(output(state, phi), expected, rtol=1e-9, atol=1e-12)
    after = network_step(state, x_d, phi, y2, gains, 0.001)
    rate1 = by_hand.rate_of_v1(phi.tolist(), y2.tolist(), gamma1.tolist())
    rate0 = by_hand.rate_of_v0(x_d.tolist(), phi.tolist(), state.v1.tolist(), y2.tolist(), gamma0.tolist())
    np.testing.assert_allclose(after.v1, state.v1 + 0.001 * np.array(rate1), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(after.v0, state.v0 + 0.001 * np.array(rate0), rtol=1e-9, atol=1e-12)


@given(seed=SEED)
def test_inside_the_ball_the_projection_changes_nothing(seed: int) -> None:
    """The band begins at |W|^2 = bound^2 / (1 + band): 2 / sqrt(1.1) = 1.907."""
    w, rate = matrix_of_size(seed, 1.9), matrix_of_size(seed + 1, 5.0)
    np.testing.assert_array_equal(project(w, rate, GAMMA, BOUND, BAND), rate)


@given(seed=SEED)
def test_a_rate_that_points_inwards_is_left_alone_everywhere(seed: int) -> None:
    w, rate = matrix_of_size(seed, 2.0), matrix_of_size(seed + 1, 5.0)
    inward = rate if float((w * rate).sum()) <= 0.0 else -rate
    np.testing.assert_array_equal(project(w, inward, GAMMA, BOUND, BAND), inward)


@given(seed=SEED)
def test_at_the_rim_nothing_outward_is_left(seed: int) -> None:
    w, rate = matrix_of_size(seed, BOUND), matrix_of_size(seed + 1, 5.0)
    outward = rate if float((w * rate).sum()) > 0.0 else -rate
    left = project(w, outward, GAMMA, BOUND, BAND)
    assert float((w * left).sum()) == pytest.approx(0.0, abs=1e-9)
    removed = outward - left
    weighted = GAMMA[:, None] * w  # what is removed is along Gamma W, so that V still falls
    cosine = float((removed * weighted).sum()) / (frobenius(removed) * frobenius(weighted))
    assert cosine == pytest.approx(1.0, abs=1e-9)


@given(seed=SEED)
def test_the_projection_never_costs_the_lyapunov_function_anything(seed: int) -> None:
    """tr((W - W*)' Gamma^-1 (proj(r) - r)) <= 0 for every W* in the inner ball: what the proof needs of proj."""
    size = float(np.random.default_rng(seed).uniform(1.9, 2.0))
    w, rate = matrix_of_size(seed, size), matrix_of_size(seed + 1, 5.0)
    ideal = matrix_of_size(seed + 2, BOUND / math.sqrt(1.0 + BAND))
    change = project(w, rate, GAMMA, BOUND, BAND) - rate
    assert float(((w - ideal) * change / GAMMA[:, None]).sum()) <= 1e-9


@given(seed=SEED, size=st.floats(1.8, 2.0))
def test_the_projection_is_continuous(seed: int, size: float) -> None:
    w, rate = matrix_of_size(seed, size), matrix_of_size(seed + 1, 5.0)
    near = project(w * (1.0 + 1e-8), rate, GAMMA, BOUND, BAND)
    np.testing.assert_allclose(near, project(w, rate, GAMMA, BOUND, BAND), atol=1e-5)


@given(seed=SEED, dt=st.floats(1e-4, 1.0))
def test_random_steps_never_leave_the_ball(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    w = matrix_of_size(seed, 1.0)
    for _ in range(30):
        w = bounded_step(w, rng.normal(0.0, 10.0, (4, 3)) + 3.0 * w, GAMMA, BOUND, BAND, dt)
        assert frobenius(w) <= BOUND * (1.0 + 1e-12)


def test_the_law_keeps_its_weights_in_the_configured_balls() -> None:
    gains = EtnnGains(v0_max=3.0, v1_max=0.5)
    state = initial_network(gains)
    for n in range(400):
        x_d, phi = hidden_layer(state, np.array([0.4 * math.cos(0.01 * n), 0.4 * math.sin(0.01 * n), 0.0]))
        state = network_step(state, x_d, phi, np.array([0.3, 0.2, -0.1]), gains, 0.01)
        assert frobenius(state.v0) <= 3.0 + 1e-9
        assert frobenius(state.v1) <= 0.5 + 1e-9
    assert frobenius(state.v1) == pytest.approx(0.5, rel=1e-3), "a steady error drives V_1 to its rim"


def test_with_no_learning_gain_the_weights_stay() -> None:
    gains = EtnnGains(gamma_v0=np.zeros(4), gamma_v1=np.zeros(5), v1_max=0.1, v0_max=2.0)
    state = NetworkState(0.1 * np.ones((4, 4)), 0.0258 * np.ones((5, 3)))  # |V_1| = 0.09992: within the band
    x_d, phi = hidden_layer(state, np.array([1.0, 2.0, 3.0]))
    after = network_step(state, x_d, phi, np.ones(3), gains, 0.01)
    np.testing.assert_array_equal(after.v0, state.v0)
    np.testing.assert_array_equal(after.v1, state.v1)
