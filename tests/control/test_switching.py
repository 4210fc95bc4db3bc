"""Theta, the fractional power and sgn, against the paper's formulas in plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.switching import fractional_power, norm_squared, sign, steepest_secant, switch_map
from tests.control import by_hand

P, EPSILON = 0.75, 1e-4
COMPONENT = st.floats(-5.0, 5.0)
NEAR = st.floats(-0.02, 0.02)
VECTOR = st.lists(st.one_of(COMPONENT, NEAR), min_size=3, max_size=3)
EXPONENT = st.floats(0.51, 0.99)


def test_outside_the_switch_theta_is_the_fractional_power() -> None:
    # |s|^2 = 16, so |s|^(2 (1 - 0.75)) = 16^(1/4) = 2
    np.testing.assert_allclose(switch_map(np.array([4.0, 0.0, 0.0]), P, EPSILON), [2.0, 0.0, 0.0])
    # |s|^2 = 9 + 16 + 144 = 169, 169^(1/4) = sqrt(13)
    expected = np.array([3.0, -4.0, 12.0]) / math.sqrt(13.0)
    np.testing.assert_allclose(switch_map(np.array([3.0, -4.0, 12.0]), P, EPSILON), expected)


def test_inside_the_switch_theta_fades_with_sin_squared() -> None:
    # |s|^2 = epsilon / 2: sin^2(pi / 4) = 1/2, and |s|^(1/2) = (5e-5)^(1/4)
    s = np.array([math.sqrt(5e-5), 0.0, 0.0])
    np.testing.assert_allclose(switch_map(s, P, EPSILON), [0.5 * 5e-5**0.25, 0.0, 0.0], rtol=1e-12)
    # a third: sin^2(pi / 6) = 1/4
    s = np.array([0.0, -math.sqrt(EPSILON / 3.0), 0.0])
    np.testing.assert_allclose(switch_map(s, P, EPSILON), [0.0, -0.25 * (EPSILON / 3.0) ** 0.25, 0.0], rtol=1e-12)


@pytest.mark.parametrize("tiny", [0.0, 5e-324, 1e-300, 1e-160, 1e-9])
def test_nothing_is_singular_at_zero(tiny: float) -> None:
    s = np.array([tiny, 0.0, -tiny])
    for value in (switch_map(s, P, EPSILON), fractional_power(s, P)):
        assert np.all(np.isfinite(value)), f"0/0 at s = 0 has the limit 0, not {value}"
        assert np.abs(value).max() <= max(1e-4, tiny**0.5)


@given(direction=VECTOR.filter(lambda v: by_hand.squared(v) > 1e-6), p=EXPONENT, epsilon=st.floats(1e-6, 1.0))
def test_theta_is_continuous_where_it_switches(direction: list[float], p: float, epsilon: float) -> None:
    unit = np.array(direction) / math.sqrt(by_hand.squared(direction))
    radius = math.sqrt(epsilon)
    inside, outside = (switch_map(unit * radius * factor, p, epsilon) for factor in (1 - 1e-9, 1 + 1e-9))
    np.testing.assert_allclose(inside, outside, atol=1e-7 * radius ** (2 * p - 1))


@given(s=VECTOR, p=EXPONENT, epsilon=st.floats(1e-6, 1.0))
def test_theta_is_the_papers_formula(s: list[float], p: float, epsilon: float) -> None:
    np.testing.assert_allclose(switch_map(np.array(s), p, epsilon), by_hand.theta(s, p, epsilon), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(fractional_power(np.array(s), p), by_hand.power(s, p), rtol=1e-9, atol=1e-14)


@given(s=VECTOR, p=EXPONENT, epsilon=st.floats(1e-6, 1.0))
def test_theta_is_bounded_by_a_line(s: list[float], p: float, epsilon: float) -> None:
    """Eq. theta-bound: |s|^q <= q |s| + (1 - q) for q = 2p - 1 in (0, 1) (weighted means)."""
    q = 2.0 * p - 1.0
    size = math.sqrt(by_hand.squared(s))
    theta = np.linalg.norm(switch_map(np.array(s), p, epsilon))
    assert theta <= q * size + (1.0 - q) + 1e-12, f"|Theta| <= k|s| + c fails at |s| = {size}"


@given(s=VECTOR, p=EXPONENT, epsilon=st.floats(1e-6, 1.0))
def test_theta_loses_at_most_epsilon_to_the_p(s: list[float], p: float, epsilon: float) -> None:
    """Case 2 of the proof: s'Theta(s) >= (s's)^p - epsilon^p."""
    value = float(np.array(s) @ switch_map(np.array(s), p, epsilon))
    assert value >= by_hand.squared(s) ** p - epsilon**p - 1e-12


@given(s=VECTOR)
def test_the_regularised_power_is_never_steeper_than_its_slope_at_zero(s: list[float]) -> None:
    e = 0.01
    value = np.linalg.norm(fractional_power(np.array(s), P, e))
    assert value <= e ** (P - 1.0) * math.sqrt(by_hand.squared(s)) + 1e-12


@given(s=VECTOR, p=EXPONENT, e=st.floats(1e-6, 1.0))
def test_the_regularised_power_loses_at_most_e_to_the_p(s: list[float], p: float, e: float) -> None:
    """What the stability proof would need of it, as it needs of Theta: s's/(s's + e)^(1-p) >= (s's)^p - e^p."""
    value = float(np.array(s) @ fractional_power(np.array(s), p, e))
    assert value >= by_hand.squared(s) ** p - e**p - 1e-12


def test_the_regularised_power_by_hand() -> None:
    # s's + e = 0.15 + 0.01 = 0.16: 0.16^(1/4) = sqrt(0.4)
    s = np.array([math.sqrt(0.15), 0.0, 0.0])
    expected = math.sqrt(0.15) / math.sqrt(0.4)
    np.testing.assert_allclose(fractional_power(s, P, 0.01), [expected, 0.0, 0.0])
    np.testing.assert_allclose(switch_map(s, P, EPSILON, 0.01), [expected, 0.0, 0.0])


def test_the_steepest_secant_is_the_largest_ratio() -> None:
    radii = [0.01 * n / 50_000 for n in range(1, 100_000)]
    largest = max(by_hand.theta([r, 0.0, 0.0], P, EPSILON)[0] / r for r in radii)
    assert steepest_secant(P, EPSILON, 0.0) == pytest.approx(largest, rel=1e-5)
    assert largest == pytest.approx(10.07, abs=0.005)
    # the regularised slope at 0: e^(p - 1) = 0.0001^(-1/4) = 10
    assert steepest_secant(P, EPSILON, 1e-4) == pytest.approx(10.0)


def test_sgn_is_componentwise_and_zero_at_zero() -> None:
    np.testing.assert_array_equal(sign(np.array([-3.0, 0.0, 1e-300])), [-1.0, 0.0, 1.0])


def test_a_boundary_layer_makes_sgn_linear_inside_it() -> None:
    np.testing.assert_allclose(sign(np.array([0.05, -0.2, 0.0]), 0.1), [0.5, -1.0, 0.0])


def test_a_batch_may_have_its_own_numbers() -> None:
    s = np.array([by_hand.random_vectors(seed, 4, 0.02) for seed in range(3)])
    p, epsilon = np.array([[0.6], [0.7], [0.8], [0.9]]), np.array([[1e-4], [2e-4], [3e-4], [4e-4]])
    layer = np.array([[0.1], [0.2], [0.3], [0.4]])
    for a in range(3):
        for b in range(4):
            one = s[a, b]
            expected = switch_map(one, float(p[b, 0]), float(epsilon[b, 0]))
            np.testing.assert_allclose(switch_map(s, p, epsilon)[a, b], expected, rtol=1e-12)
            np.testing.assert_allclose(sign(s, layer)[a, b], sign(one, float(layer[b, 0])), rtol=1e-12)
            np.testing.assert_allclose(norm_squared(s)[a, b], [by_hand.squared(list(one))], rtol=1e-12)
