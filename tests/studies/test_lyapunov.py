"""V of eq. V-comp and the ideal weights, against numbers worked out by hand and against what defines them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.gains import EtnnGains
from companion.control.network import NetworkState, hidden_layer
from companion.core.types import Array
from companion.studies.theory.lyapunov import (
    Bounds,
    IdealWeights,
    fit_ideal_output_weights,
    lyapunov_of,
    measured_bounds,
)
from tests.control import by_hand

GAMMA_BY_ROW = EtnnGains(
    gamma_v0=np.array([1.0, 2.0, 4.0, 8.0]).tolist(), gamma_v1=np.array([1.0, 2.0, 4.0, 8.0, 0.0]).tolist()
)


def one_instant() -> tuple[dict[str, Array], IdealWeights]:
    """V~_0 is 2 in each of its 4 x 4, V~_1 is 3 in each of its 5 x 3."""
    signals = {
        "y1": np.array([3.0, 4.0, 0.0]),
        "y2": np.array([0.0, -2.0, 0.0]),
        "iota1": np.array([1.0, 1.0, 1.0]),
        "iota2": np.array([0.0, 0.0, 0.1]),
        "v0": np.full((4, 4), -1.0),
        "v1": np.full((5, 3), 4.0),
    }
    return signals, IdealWeights(np.full((4, 4), 1.0), np.full((5, 3), 7.0), 0.0)


def test_the_parts_of_v_by_hand() -> None:
    signals, ideal = one_instant()
    v = lyapunov_of(signals, GAMMA_BY_ROW, ideal)
    assert [float(part) for part in (v.y1, v.y2, v.iota1, v.iota2)] == pytest.approx([12.5, 2.0, 1.5, 0.005])
    # 1/2 * 4 columns * 2^2 * (1 + 1/2 + 1/4 + 1/8); 1/2 * 3 columns * 3^2 * the same, a row without gain left out
    assert float(v.weights0) == pytest.approx(8.0 * 1.875)
    assert float(v.weights1) == pytest.approx(13.5 * 1.875)
    assert float(v.states) == pytest.approx(16.005)
    assert float(v.total) == pytest.approx(16.005 + 21.5 * 1.875)


def test_without_ideal_weights_v_is_that_of_the_states() -> None:
    signals, _ = one_instant()
    v = lyapunov_of(signals, GAMMA_BY_ROW)
    assert float(v.total) == float(v.states) == pytest.approx(16.005)


def test_a_flight_of_many_is_each_instant_of_each() -> None:
    rng = np.random.default_rng(5)
    shapes = {"y1": (3,), "y2": (3,), "iota1": (3,), "iota2": (3,), "v0": (4, 4), "v1": (5, 3)}
    signals = {name: rng.normal(size=(6, 2, *shape)) for name, shape in shapes.items()}
    _, ideal = one_instant()
    whole = lyapunov_of(signals, GAMMA_BY_ROW, ideal).total
    assert whole.shape == (6, 2)
    for index in np.ndindex(6, 2):
        one = lyapunov_of({name: signal[index] for name, signal in signals.items()}, GAMMA_BY_ROW, ideal)
        assert float(whole[index]) == pytest.approx(float(one.total), rel=1e-12)


def flown(seed: int, count: int = 60) -> tuple[Array, Array]:
    """V_0 and reference velocities (n, 3)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(4, 4)), rng.uniform(-0.5, 0.5, (count, 3))


def features(v0: Array, velocity: Array) -> Array:
    return np.array([by_hand.activations(v0.tolist(), [*row, 1.0]) for row in velocity.tolist()])


def test_a_friction_that_a_network_makes_is_found_again() -> None:
    v0, velocity = flown(1)
    v1 = np.random.default_rng(2).normal(size=(5, 3))
    ideal = fit_ideal_output_weights(v0, velocity, features(v0, velocity) @ v1, EtnnGains())
    np.testing.assert_allclose(ideal.v1, v1, rtol=1e-6)
    np.testing.assert_array_equal(ideal.v0, v0)
    assert ideal.residual_mps2 < 1e-9


@given(seed=st.integers(0, 2**32 - 1), radius=st.floats(0.01, 1.0))
def test_in_a_small_ball_no_other_weights_of_the_ball_come_closer(seed: int, radius: float) -> None:
    v0, velocity = flown(seed)
    rng = np.random.default_rng(seed)
    friction = rng.normal(size=(60, 3))
    ideal = fit_ideal_output_weights(v0, velocity, friction, EtnnGains(v1_max=radius))
    inner = radius / math.sqrt(1.1)
    assert float(np.linalg.norm(ideal.v1)) <= inner * (1.0 + 1e-9)
    phi = features(v0, velocity)
    least = float(np.linalg.norm(phi @ ideal.v1 - friction))
    for size in (1e-3, 0.1, 3.0):
        other = ideal.v1 + size * inner * rng.normal(size=(5, 3))
        other *= min(1.0, inner / float(np.linalg.norm(other)))
        assert float(np.linalg.norm(phi @ other - friction)) >= least - 1e-9
    assert ideal.residual_mps2 == pytest.approx(max(np.linalg.norm(phi @ ideal.v1 - friction, axis=-1)), rel=1e-9)


def test_ideal_hidden_weights_come_into_the_ball_where_the_projection_costs_nothing() -> None:
    v0, velocity = flown(3)
    ideal = fit_ideal_output_weights(v0 * 100.0, velocity, np.zeros((60, 3)), EtnnGains(v0_max=2.2))
    assert float(np.linalg.norm(ideal.v0)) == pytest.approx(2.2 / math.sqrt(1.1))
    np.testing.assert_array_equal(ideal.v1, np.zeros((5, 3)))


def test_at_rest_one_velocity_is_fitted_with_the_smallest_weights() -> None:
    """All rows alike: phi phi' v1 = f has many answers; the least is phi f'/|phi|^2."""
    v0, _ = flown(4)
    _, phi = hidden_layer(NetworkState(v0, np.zeros((5, 3))), np.zeros(3))
    push = np.array([0.1, -0.2, 0.3])
    ideal = fit_ideal_output_weights(v0, np.zeros((9, 3)), np.tile(push, (9, 1)), EtnnGains())
    np.testing.assert_allclose(ideal.v1, np.outer(phi, push) / float(phi @ phi), rtol=1e-9)


def test_the_bounds_a_flight_kept() -> None:
    signals, ideal = one_instant()
    two = {name: np.stack((signal, 0.5 * signal)) for name, signal in signals.items()}
    two |= {
        "chi": np.array([[0.3, 0.0, 0.0], [1.0, 2.0, 2.0]]),
        "alpha1": np.array([[0.0, 0.4, 0.0], [1.0, 2.0, 2.0]]),
        "f_hat": np.array([[0.0, 0.0, 0.0], [2.0, -1.0, 2.0]]),
    }
    velocity = np.array([[0.0, 0.75, 0.0], [0.1, 0.0, 0.0]])
    found = measured_bounds(two, velocity, delta_mps2=0.7, lipschitz_per_s=0.2, ideal=ideal)
    # V~_0: 2 then 1.5 in 16 places; V~_1: 3 then 5 in 15; V_1: 4 in 15
    root = math.sqrt(15.0)
    expected = Bounds(
        delta_mps2=0.7,
        lipschitz_per_s=0.2,
        filter_error_mps=0.5,
        f_hat_mps2=3.0,
        residual_mps2=ideal.residual_mps2,
        x_d=1.25,
        v0_error=8.0,
        v1_error=5.0 * root,
        v1_size=4.0 * root,
    )
    for name, value in vars(expected).items():
        assert getattr(found, name) == pytest.approx(value), name
    bare = measured_bounds(two, velocity, delta_mps2=0.7, lipschitz_per_s=0.2)
    assert bare == Bounds(
        delta_mps2=0.7, lipschitz_per_s=0.2, filter_error_mps=found.filter_error_mps, f_hat_mps2=3.0, x_d=1.25
    )
