"""Behaviour of the printed law on an ideal plant, and limits of the stability proof."""

import math
import tomllib

import numpy as np
import pytest

from companion.config.locations import project_root
from companion.control.etnn import FilterState, filter_step, virtual_control_1, virtual_control_2
from companion.control.gains import EtnnGains
from companion.trajectories.reference import Ellipse, Hold
from tests.control.ideal_plant import Run, simulate

CENTRE = np.array([0.0, 0.0, 1.2])
ELLIPSE = Ellipse(CENTRE)  # 1 x 0.6 m, 15 s a lap
PRINTED = EtnnGains.model_validate(
    tomllib.loads((project_root() / "config/controllers/paper.toml").read_text(encoding="utf-8"))["gains"]
)
STABILISED = PRINTED.model_copy(update={"filter_eps": 0.03, "zeta": 1.0, "rho": 1.0})
NOTHING_LEARNT = {"gamma_v0": np.zeros(4), "gamma_v1": np.zeros(5)}


@pytest.fixture(scope="module")
def printed_run() -> Run:
    return simulate(PRINTED, ELLIPSE, 12.0)


def test_as_printed_the_law_leaves_two_metres_within_a_few_seconds(printed_run: Run) -> None:
    assert printed_run.left_at_s is not None, "the printed gains fail rho/eps > k + s and must diverge even here"
    assert printed_run.left_at_s == pytest.approx(5.6, abs=0.2)


def test_it_is_the_compensation_that_carries_the_vehicle_away(printed_run: Run) -> None:
    """y_1 = x_1 - iota_1 stays small, as proved; x_1 is small only if iota_1 is, and that is what fails."""
    assert float(np.abs(printed_run.signals["y1"]).max()) < 0.005
    assert float(np.linalg.norm(printed_run.signals["iota1"][-1])) > 1.9


def test_slower_sampling_is_not_the_cause() -> None:
    run = simulate(PRINTED, ELLIPSE, 12.0, dt_s=0.01)
    assert run.left_at_s == pytest.approx(5.6, abs=0.2)


def test_as_printed_it_does_not_even_hover_from_ten_centimetres_away() -> None:
    run = simulate(PRINTED, Hold(CENTRE), 12.0, dt_s=0.01, offset_m=(0.1, 0.1, 0.1))
    assert run.left_at_s is not None


def test_a_smaller_filter_eps_alone_flies_only_while_nothing_disturbs_it() -> None:
    """rho/eps = 3.3 exceeds k = 3 of x and y but not k = 4 of z: on the ideal plant z is simply never touched."""
    lone = EtnnGains(filter_eps=0.03, switching=0.0)
    undisturbed = simulate(lone, ELLIPSE, 8.0)
    assert undisturbed.left_at_s is None
    assert float(np.abs(undisturbed.error_m).mean(axis=0).max()) < 0.005
    disturbed = simulate(lone, ELLIPSE, 15.0, dt_s=0.005, offset_m=(0.0, 0.0, 0.01))
    assert disturbed.left_at_s is not None, "one centimetre in z is enough"


@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_the_set_that_meets_the_condition_stays_with_everything_on(lag_s: float) -> None:
    run = simulate(STABILISED, ELLIPSE, 15.0, dt_s=0.005, lag_s=lag_s, offset_m=(0.2, -0.2, 0.1))
    assert run.left_at_s is None
    late = np.abs(run.error_m[len(run.error_m) // 2 :])
    assert float(late.mean(axis=0).max()) < 0.005
    assert float(late.max()) < 0.02


def test_the_condition_tells_the_two_sets_apart() -> None:
    damping, needed = PRINTED.filter_loop()
    assert damping < needed
    damping, needed = STABILISED.filter_loop()
    assert damping > needed


@pytest.mark.parametrize("gains", [PRINTED, STABILISED], ids=["printed", "stabilised"])
def test_the_y_part_of_the_lyapunov_function_falls_with_printed_gains_too(gains: EtnnGains) -> None:
    """V_y = (y_1'y_1 + y_2'y_2)/2 with no friction, no disturbance and no learning.

    y_1' = y_2 - beta_1 .. - gamma_1 .. and y_2' = -y_1 - beta_2 .. - gamma_2 .. + (u - alpha_2), so V_y falls whatever
    the filter does. In steps of 1 ms it falls down to the chatter of sgn, (sigma + sigma/delta) dt = 0.6 mm/s.
    """
    run = simulate(gains.model_copy(update=NOTHING_LEARNT), Hold(CENTRE), 2.0, offset_m=(0.3, -0.2, 0.1))
    v = 0.5 * sum(np.vecdot(run.signals[name], run.signals[name]) for name in ("y1", "y2"))
    high = v[:-1] > 1e-4
    assert float(v[0]) == pytest.approx(0.5 * (0.09 + 0.04 + 0.01 + _y2_squared_at_start()), rel=1e-9)
    assert np.all(np.diff(v)[high] < 0.0), "V_y rose on an ideal plant"
    assert float(v[-1]) < 1e-4


def test_events_have_no_dwell_time_but_the_control_period() -> None:
    """Once y_2 has come to 0 each crossing is an event and turns it back: finer steps only send more often.

    The paper excludes this (eq. zeno1) with a jump of sgn(y_2) by 1; from -1 to 1 it is 2, twice the threshold.
    """
    gains = STABILISED.model_copy(update=NOTHING_LEARNT)
    sent_per_s = []
    for dt_s in (0.002, 0.001):
        run = simulate(gains, Hold(CENTRE), 2.0, dt_s=dt_s, offset_m=(0.1, -0.1, 0.1))
        late = run.signals["event"][len(run.signals["event"]) // 2 :]
        sent_per_s.append(float(late.mean()) / dt_s)
    coarse, fine = sent_per_s
    assert fine > 1.9 * coarse
    assert fine > 800.0


def test_what_the_network_learns_stays_in_the_position_error() -> None:
    """f_hat drives iota_2, not u: a steady push learnt wholly leaves y = 0 and x_1 = iota_1, which is not 0.

    At rest iota_2 = -alpha_1 = 3 iota_1 + Theta(iota_1) + iota_1^3 and f_hat = iota_1 + iota_2^3 + 0.8 iota_2^(1/2).
    For 0.1 m/s^2 that is 3.8 mm: 3 * 0.0038 + 0.0506 * 0.0616 = 0.0145, and 0.0038 + 0.8 * 0.1204 = 0.1.
    """
    f_hat, still = np.array([0.1, 0.0, 0.0]), np.zeros(3)
    state = FilterState(still, still, still, still)
    for _ in range(3000):
        alpha1 = virtual_control_1(still, still, state.iota1, STABILISED)
        state = filter_step(state, alpha1, f_hat, STABILISED, 0.005)
    assert float(state.iota1[0]) == pytest.approx(0.0038, abs=5e-5)
    u = virtual_control_2(state.xi, state.iota1, still, state.iota2, STABILISED)
    np.testing.assert_allclose(u, -f_hat, atol=1e-6)


def _y2_squared_at_start() -> float:
    """y_2 = v - chi = -alpha_1(0): |beta_1 |x|^2 x + gamma_1 x/|x|^(1/2)|^2, at x = (0.3, -0.2, 0.1)."""
    x, diag = (0.3, -0.2, 0.1), (1.0, 1.0, 1.2)
    size = 0.14
    return math.fsum((d * size * a + d * a / size**0.25) ** 2 for a, d in zip(x, diag, strict=True))
