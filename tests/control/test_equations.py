"""Table of the equations of the paper and the tests with numbers worked out by hand, and the remaining tests.

| equation | test |
| --- | --- |
| mod, and u = U_c/m_t - g e_3 | here; test_attitude.py `the_force_is_mass_times_u_plus_gravity` |
| Theta (Lemma 1), theta-bound | test_switching.py; here: how smooth it is |
| DNN:fd:hat | test_network.py `the_output_by_hand` |
| update1, update2, proj | here; test_network.py: indices, and what the proof needs of proj |
| z-def, v-def | here: a whole cycle |
| cmd-filter, iota-dyn | test_command_filter.py `one_step_of_..._by_hand` |
| alpha1, alpha_2 | test_command_filter.py; here: with every term at once |
| ETC-law, key-ineq | test_event_trigger.py; here: two crossings, for eq. zeno |
| V_1, V_2, V-comp, DNN:Vtilde | tests/studies/test_lyapunov.py |
| Vdot_ft, V_bound, T_bound, and every eq. from S-Lip1 to V-dot | tests/studies/test_fixed_time.py |
| the PID of section 5.1 | test_pid.py |
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.controller import ControlInput
from companion.control.etnn import (
    Etnn,
    TriggerState,
    continuous_control,
    trigger_step,
    virtual_control_1,
    virtual_control_2,
)
from companion.control.gains import EtnnGains
from companion.control.network import NetworkState, hidden_layer, network_step, project
from companion.control.switching import switch_map
from companion.core.types import Array, Reference
from mock_autopilot.physics import plant
from tests.control import by_hand

GAINS = EtnnGains()
ZERO = np.zeros(3)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
SMALL_M = math.sqrt(5e-5)
"""|s|^2 = epsilon/2: Theta is half of s/|s|^(1/2) there."""


def test_the_simulated_vehicle_obeys_the_model() -> None:
    """Eq. mod, level: U_c = 60 N up; F_f at 2 m/s is 0.6 * 2 + 0.3 * 4 + 0.4 = 2.8 N; F_d + F_m = -1 N along east."""
    params = plant.PlantParams()
    state = replace(
        plant.at_rest(np.array([0.0, 0.0, -100.0])),
        velocity_ned_mps=np.array([2.0, 0.0, 0.0]),
        thrust_n=np.asarray(60.0),
    )
    steady = plant.Actuation(LEVEL, np.asarray(60.0 / params.max_thrust_n))
    after = plant.step(state, steady, plant.Wrench(np.array([0.0, 1.0, 0.0]), ZERO), params, 1e-6)
    up_mps2 = 60.0 / 4.85 - 9.80665
    expected = [-2.8 / 4.85, 1.0 / 4.85, -up_mps2]
    np.testing.assert_allclose((after.velocity_ned_mps - state.velocity_ned_mps) / 1e-6, expected, rtol=1e-6)


Q = 0.5 * 5e-5**0.25  # Theta of SMALL_M
ALPHA_1 = [
    # iota_1 = 4 along x: c_1 64 + k 4 + k_1 2 = 78; y_1 = -4 along z: 1.2 * 64 + 1.2 * 2 = 79.2
    ([0.5, -0.25, 1.0], [0.0, 0.0, -4.0], [4.0, 0.0, 0.0], [0.5 - 78.0, -0.25, 1.0 + 79.2]),
    # both inside the switch, both along z: k 4, k_1 = gamma_1 = c_1 = beta_1 = 1.2
    ([0.0] * 3, [0.0, 0.0, SMALL_M], [0.0, 0.0, SMALL_M], [0.0, 0.0, -4.0 * SMALL_M - 2.4 * (SMALL_M**3 + Q)]),
    # y_1 = (3, -4, 12): |y_1|^2 = 169, 169^(1/4) = sqrt(13): 169 + 1/sqrt(13) of each component, times 1, 1, 1.2
    (
        [0.0] * 3,
        [3.0, -4.0, 12.0],
        [0.0] * 3,
        [-507.0 - 3.0 / math.sqrt(13.0), 676.0 + 4.0 / math.sqrt(13.0), -2433.6 - 14.4 / math.sqrt(13.0)],
    ),
]
ALPHA_2 = [
    # iota_2 = 4 along y: c_2 64 + k_2 2 = 65.6; y_2 = -4 along z: 0.7 * 64 + 1.2 * 2 = 47.2
    ([1.0, 2.0, 3.0], [0.1, -0.2, 0.3], [0.0, 0.0, -4.0], [0.0, 4.0, 0.0], [0.9, 2.2 - 65.6, 2.7 + 47.2]),
    # close to 0 the power does not fade: y_2 = 0.0001 along x is 0.01 of it; iota_2 the same: 0.8 of it
    ([0.0] * 3, [0.0] * 3, [1e-4, 0.0, 0.0], [1e-4, 0.0, 0.0], [-0.01 - 0.008 - 0.6e-12 - 1e-12, 0.0, 0.0]),
]


@pytest.mark.parametrize(("velocity_ref", "y1", "iota1", "expected"), ALPHA_1)
def test_the_velocity_wanted(velocity_ref: list[float], y1: list[float], iota1: list[float], expected: Array) -> None:
    found = virtual_control_1(np.array(velocity_ref), np.array(y1), np.array(iota1), GAINS)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(("chi_dot", "x1", "y2", "iota2", "expected"), ALPHA_2)
def test_the_acceleration_wanted(
    chi_dot: list[float], x1: list[float], y2: list[float], iota2: list[float], expected: Array
) -> None:
    found = virtual_control_2(np.array(chi_dot), np.array(x1), np.array(y2), np.array(iota2), GAINS)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_whole_cycle_one_metre_away() -> None:
    """Eqs. z-def, v-def, alpha1, cmd-filter's start, alpha_2, ETC-law in a row, at lift-off.

    Along x: x_1 = y_1 = 1, alpha_1 = p_d' - 1 - 1 = -1.5 = chi, y_2 = x_2 = v - chi = 0.5 + 1.5 = 2;
    alpha_2 = -x_1 - 0.6 * 8 - 2/2^(1/2), u = alpha_2 - sigma.
    """
    reference = Reference(np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.0, 0.0]), ZERO, 0.0)
    now = ControlInput(
        position_w_m=np.array([1.0, 0.0, 1.0]),
        velocity_w_mps=np.array([0.5, 0.0, 0.0]),
        q_w_flu_wxyz=LEVEL,
        rate_flu_radps=ZERO,
        age_s=0.0,
        reference=reference,
        sent_accel_w_mps2=ZERO,
        dt_s=0.01,
    )
    law = Etnn(GAINS)
    _, out = law.step(law.initial(now), now)
    alpha2 = -1.0 - 4.8 - math.sqrt(2.0)
    for name, along_x in {"x1": 1.0, "y1": 1.0, "alpha1": -1.5, "chi": -1.5, "y2": 2.0, "alpha2": alpha2}.items():
        np.testing.assert_allclose(out.signals[name], [along_x, 0.0, 0.0], rtol=1e-12, err_msg=name)
    np.testing.assert_allclose(out.accel_w_mps2, [alpha2 - 0.05, 0.0, 0.0], rtol=1e-12)
    assert out.event == 1.0


def test_one_step_of_both_weights() -> None:
    """Gamma = 100, dt = 0.01, so each step is the product itself. V_0 = 0: phi = 1/2, its slope 1/4."""
    v1 = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 9.0]])
    state = NetworkState(np.zeros((4, 4)), v1)
    x_d, phi = hidden_layer(state, np.array([0.5, 0.0, -1.0]))
    gains = EtnnGains(v0_max=1e6, v1_max=1e6)
    after = network_step(state, x_d, phi, np.array([1.0, -2.0, 3.0]), gains, 0.01)
    half = [0.5, -1.0, 1.5]
    np.testing.assert_allclose(after.v1 - v1, [half, half, half, half, [1.0, -2.0, 3.0]], rtol=1e-12)
    # V_1 y_2 = (1, -2, 3, 2) without the bias' row, a quarter of it, times x_d = (1/2, 0, -1, 1)
    back = np.array([0.25, -0.5, 0.75, 0.5])
    np.testing.assert_allclose(after.v0, [0.5 * back, 0.0 * back, -back, back], rtol=1e-12)


def test_half_way_through_the_band_half_of_the_outward_rate_is_left() -> None:
    """((1 + 0.1) |W|^2 - 4)/(0.1 * 4) = 1/2 at |W|^2 = 4.2/1.1; only along W, so the other row keeps its rate."""
    w = np.array([[math.sqrt(4.2 / 1.1)], [0.0]])
    rate, gamma = np.array([[1.0], [5.0]]), np.array([2.0, 3.0])
    np.testing.assert_allclose(project(w, rate, gamma, 2.0, 0.1), [[0.5], [5.0]], rtol=1e-12)


def test_theta_is_smooth_once_but_not_twice() -> None:
    """Lemma 1 says twice. With r = |s| and q = 2p - 1, Theta is r^q outside and r^q sin^2(pi r^2/(2 epsilon)) inside.

    At r^2 = epsilon the slopes meet, and the second derivatives differ by 2 pi^2 epsilon^(q/2 - 1) = 2000 pi^2: alpha_1
    is not twice differentiable there, as Property 1 asks.
    """

    def theta(r: float) -> float:
        return float(switch_map(np.array([r, 0.0, 0.0]), 0.75, 1e-4)[0])

    at, h = 0.01, 1e-6
    slopes = [(theta(at + h * side) - theta(at)) / (h * side) for side in (1.0, -1.0)]
    assert slopes[0] == pytest.approx(0.5 * 0.01**-0.5, rel=1e-3)
    assert slopes[1] == pytest.approx(slopes[0], rel=5e-3)
    bends = [(theta(at + 2.0 * h * side) - 2.0 * theta(at + h * side) + theta(at)) / h**2 for side in (1.0, -1.0)]
    assert bends[0] - bends[1] == pytest.approx(2000.0 * math.pi**2, rel=1e-3)


@pytest.mark.parametrize(
    ("before", "after", "jump", "event"),
    [
        (0.0, 1e-9, 0.15, 0.0),  # from 0, as eq. zeno1 has it: just the threshold
        (-1e-9, 1e-9, 0.3, 1.0),  # through 0: twice the threshold, an event however short the time between
    ],
)
def test_what_a_crossing_of_zero_does_to_the_command(before: float, after: float, jump: float, event: float) -> None:
    """Eq. zeno with the same alpha_2, kappa = 0.01 and no time between: sigma + kappa/delta = 0.15."""
    kappa = np.array([0.01])
    sent, new = (continuous_control(ZERO, np.array([y2, 0.0, 0.0]), kappa, GAINS) for y2 in (before, after))
    np.testing.assert_allclose(sent - new, [jump, 0.0, 0.0], rtol=1e-12)
    slightly_less = sent - 0.999 * (sent - new)
    _, _, happened = trigger_step(TriggerState(sent, kappa, np.ones(1)), slightly_less, GAINS, 0.0)
    assert happened == event


@given(seed=st.integers(0, 2**32 - 1), kappa=st.floats(0.0, 1.0))
def test_no_two_events_in_one_instant(seed: int, kappa: float) -> None:
    held, wanted = (np.array(v) for v in by_hand.random_vectors(seed, 2))
    state = TriggerState(held, np.array([kappa]), np.ones(1))
    for expected in (1.0 if float(np.abs(held - wanted).max()) > 0.05 + kappa / 0.1 else 0.0, 0.0):
        state, _, event = trigger_step(state, wanted, GAINS, 0.0)
        assert event == expected
