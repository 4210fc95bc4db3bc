"""Command filter, compensation, alpha_1 and alpha_2 against numbers worked out by hand and against plain loops."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.control.etnn import Etnn, FilterState, filter_step, virtual_control_1, virtual_control_2
from companion.control.gains import EtnnGains
from tests.control import by_hand
from tests.control.test_whole_laws import inputs

GAINS = EtnnGains()
ZERO = np.zeros(3)
VECTOR = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
G, P, EPS = by_hand.PRINTED, 0.75, 1e-4


def test_the_first_compensation_by_hand() -> None:
    # |iota_1|^2 = 16 along x: c_1 16 * 4 + k 4 + k_1 4/2 = 64 + 12 + 2
    alpha1 = virtual_control_1(ZERO, ZERO, np.array([4.0, 0.0, 0.0]), GAINS)
    np.testing.assert_allclose(alpha1, [-78.0, 0.0, 0.0])
    # along z: 1.2 * 64 + 4 * 4 + 1.2 * 2
    alpha1 = virtual_control_1(ZERO, ZERO, np.array([0.0, 0.0, 4.0]), GAINS)
    np.testing.assert_allclose(alpha1, [0.0, 0.0, -95.2])


def test_the_second_compensation_by_hand() -> None:
    # c_2 64 + k_2 2 with k_2 = 0.8 along y
    alpha2 = virtual_control_2(ZERO, ZERO, ZERO, np.array([0.0, 4.0, 0.0]), GAINS)
    np.testing.assert_allclose(alpha2, [0.0, -65.6, 0.0])


@given(v=VECTOR, y=VECTOR, iota=VECTOR, x=VECTOR)
def test_both_virtual_controls_are_the_papers_formulas(
    v: list[float], y: list[float], iota: list[float], x: list[float]
) -> None:
    first = virtual_control_1(np.array(v), np.array(y), np.array(iota), GAINS)
    np.testing.assert_allclose(first, by_hand.alpha_1(v, y, iota, G, P, EPS), rtol=1e-10, atol=1e-11)
    second = virtual_control_2(np.array(v), np.array(x), np.array(y), np.array(iota), GAINS)
    np.testing.assert_allclose(second, by_hand.alpha_2(v, x, y, iota, G, P), rtol=1e-10, atol=1e-11)


def test_the_filter_starts_on_its_input() -> None:
    (now,) = inputs((), 1)
    x1 = now.position_w_m - now.reference.position_w_m
    start = Etnn(GAINS).initial(now).filter
    np.testing.assert_array_equal(start.chi, virtual_control_1(now.reference.velocity_w_mps, x1, ZERO, GAINS))
    for still in (start.xi, start.iota1, start.iota2):
        np.testing.assert_array_equal(still, ZERO)


def test_one_step_of_the_filter_by_hand() -> None:
    # eps = 0.5, zeta = 2, rho = 3: xi' = -4 (2 atan(1) + 3 atan(0.5 * 2)) = -4 (5 pi/4) = -5 pi
    gains = EtnnGains(filter_eps=0.5, zeta=2.0, rho=3.0)
    state = FilterState(np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]), ZERO, ZERO)
    after = filter_step(state, ZERO, ZERO, gains, 0.01)
    xi = 2.0 - 0.01 * 5.0 * math.pi
    np.testing.assert_allclose(after.xi, [xi, 0.0, 0.0])
    np.testing.assert_allclose(after.chi, [1.0 + 0.01 * xi, 0.0, 0.0])


def test_one_step_of_the_compensation_by_hand() -> None:
    state = FilterState(np.array([0.3, 0.0, 0.0]), ZERO, np.array([4.0, 0.0, 0.0]), np.array([0.0, 4.0, 0.0]))
    after = filter_step(state, np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 7.0]), GAINS, 0.01)
    # iota_1' = iota_2 + chi - alpha_1 - (c_1 16 * 4 + k 4 + k_1 2)
    np.testing.assert_allclose(after.iota1, [4.0 + 0.01 * (0.2 - 78.0), 0.04, 0.0])
    # iota_2' = -iota_1 - (c_2 16 * 4 + k_2 2) + f_hat
    np.testing.assert_allclose(after.iota2, [-0.04, 4.0 - 0.01 * 65.6, 0.07])


def test_a_share_of_the_compensation_moves_it_by_that_share_and_the_filter_as_ever() -> None:
    vectors = np.random.default_rng(3).normal(size=(4, 3))
    state, alpha1, f_hat = FilterState(*vectors), np.array([0.4, -0.2, 0.1]), np.array([0.3, 0.1, -0.5])
    whole = filter_step(state, alpha1, f_hat, GAINS, 0.01)
    for share in (0.0, 0.25):
        part = filter_step(state, alpha1, f_hat, EtnnGains(compensation=share), 0.01)
        np.testing.assert_array_equal(part.chi, whole.chi)
        np.testing.assert_array_equal(part.xi, whole.xi)
        np.testing.assert_allclose(part.iota1 - state.iota1, share * (whole.iota1 - state.iota1), atol=1e-15)
        np.testing.assert_allclose(part.iota2 - state.iota2, share * (whole.iota2 - state.iota2), atol=1e-15)


@pytest.mark.parametrize("target", [-1.0, 0.3, 2.0])
def test_the_filter_settles_on_a_steady_input(target: float) -> None:
    gains = EtnnGains(filter_eps=0.03, zeta=1.0, rho=1.0)
    state = FilterState(ZERO, ZERO, ZERO, ZERO)
    alpha1 = np.full(3, target)
    for _ in range(300):
        state = filter_step(state, alpha1, ZERO, gains, 0.01)
    np.testing.assert_allclose(state.chi, alpha1, atol=1e-6)
    np.testing.assert_allclose(state.xi, ZERO, atol=1e-5)


@given(dt=st.floats(1e-3, 0.02), eps=st.floats(0.003, 0.3), zeta=st.floats(0.1, 2.0), rho=st.floats(0.05, 1.5))
def test_the_filters_steps_are_stable_iff_the_gains_say_so(dt: float, eps: float, zeta: float, rho: float) -> None:
    """Small signals step by z^2 - (2 - a - w) z + (1 - a) with a = rho dt/eps, w = zeta dt^2/eps^2."""
    a, w = rho * dt / eps, zeta * dt**2 / eps**2
    gains = EtnnGains(filter_eps=eps, zeta=zeta, rho=rho)
    columns = []
    for chi, xi in ((1e-7, 0.0), (0.0, 1e-7)):
        after = filter_step(FilterState(np.full(3, chi), np.full(3, xi), ZERO, ZERO), ZERO, ZERO, gains, dt)
        columns.append([after.chi[0] / 1e-7, after.xi[0] / 1e-7])
    (m00, m10), (m01, m11) = columns
    assert m00 + m11 == pytest.approx(2.0 - a - w, abs=1e-6)
    assert m00 * m11 - m01 * m10 == pytest.approx(1.0 - a, abs=1e-6)
    load = gains.filter_step_load(dt)
    assert load == pytest.approx(2.0 * a + w)
    assume(abs(load - 4.0) > 1e-3)
    assert (float(abs(np.roots([1.0, -(2.0 - a - w), 1.0 - a])).max()) < 1.0) == (load < 4.0)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_what_goes_past_the_filter_is_not_late(share: float) -> None:
    """Behind an input that changes at a rate a the filter is late by rho eps/zeta a, but for what passes it."""
    gains = EtnnGains(filter_eps=0.1, zeta=2.0, rho=1.0)
    accel = np.array([0.02, -0.01, 0.0])  # small: atan is linear
    state, alpha1 = FilterState(ZERO, ZERO, ZERO, ZERO), ZERO
    for _ in range(3000):
        state = filter_step(state, alpha1, ZERO, gains, 0.001, share * accel)
        alpha1 = alpha1 + 0.001 * accel
    late_s = gains.rho * gains.filter_eps / gains.zeta
    np.testing.assert_allclose(alpha1 - state.chi, (1.0 - share) * late_s * accel, atol=3e-5)
    np.testing.assert_allclose(state.xi, (1.0 - share) * accel, atol=1e-4)
