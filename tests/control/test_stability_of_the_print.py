"""What the printed law does on an ideal plant, and what the stability proof does and does not cover.

The plant is a point mass whose acceleration is the command, at once or after a first-order lag; no noise, no friction.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from companion.control.controller import ControlInput
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains
from companion.control.reference import Ellipse, Hold, Trajectory
from companion.types import Array, Reference

CENTRE = np.array([0.0, 0.0, 1.2])
ELLIPSE = Ellipse(CENTRE)  # 1 x 0.6 m, 15 s a lap
PRINTED = EtnnGains()
STABILISED = EtnnGains(filter_eps=0.03, zeta=1.0, rho=1.0)
TOO_FAR_M = 2.0


@dataclass(frozen=True)
class Run:
    """Error (n, 3), y_1 (n, 3), iota_1 (n, 3) and V_y of each step; when 2 m was left, or None."""

    error_m: Array
    y1: Array
    iota1: Array
    lyapunov_y: Array
    left_at_s: float | None


def simulate(
    gains: EtnnGains,
    trajectory: Trajectory,
    for_s: float,
    *,
    dt_s: float = 0.001,
    lag_s: float = 0.0,
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    reference: Callable[[float], Reference] | None = None,
) -> Run:
    law, at = Etnn(gains), reference or trajectory.at
    p, v = at(0.0).position_w_m + np.array(offset_m), np.zeros(3)
    a, u, still = np.zeros(3), np.zeros(3), np.zeros(3)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    follow = 1.0 if lag_s == 0.0 else 1.0 - float(np.exp(-dt_s / lag_s))
    memory, rows, left_at = None, [], None
    for n in range(round(for_s / dt_s)):
        now = ControlInput(p, v, level, still, 0.0, at(n * dt_s), u, dt_s)
        memory = law.initial(now) if memory is None else memory
        memory, out = law.step(memory, now)
        u, s = out.accel_w_mps2, out.signals
        error = p - now.reference.position_w_m
        rows.append(np.concatenate((error, s["y1"], s["iota1"], [0.5 * (s["y1"] @ s["y1"] + s["y2"] @ s["y2"])])))
        if float(np.linalg.norm(error)) > TOO_FAR_M:
            left_at = n * dt_s
            break
        a = a + follow * (u - a)
        p, v = p + dt_s * v + 0.5 * dt_s**2 * a, v + dt_s * a
    table = np.array(rows)
    return Run(table[:, :3], table[:, 3:6], table[:, 6:9], table[:, 9], left_at)


@pytest.fixture(scope="module")
def printed_run() -> Run:
    return simulate(PRINTED, ELLIPSE, 12.0)


def test_as_printed_the_law_leaves_two_metres_within_a_few_seconds(printed_run: Run) -> None:
    assert printed_run.left_at_s is not None, "the printed gains fail rho/eps > k + s and must diverge even here"
    assert printed_run.left_at_s == pytest.approx(5.6, abs=0.2)


def test_it_is_the_compensation_that_carries_the_vehicle_away(printed_run: Run) -> None:
    """y_1 = x_1 - iota_1 stays small, as proved; x_1 is small only if iota_1 is, and that is what fails."""
    assert float(np.abs(printed_run.y1).max()) < 0.005
    assert float(np.linalg.norm(printed_run.iota1[-1])) > 1.9


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
    deaf = gains.model_copy(update={"gamma_v0": np.zeros(4), "gamma_v1": np.zeros(5)})
    run = simulate(deaf, Hold(CENTRE), 2.0, offset_m=(0.3, -0.2, 0.1))
    v = run.lyapunov_y
    high = v[:-1] > 1e-4
    assert float(v[0]) == pytest.approx(0.5 * (0.09 + 0.04 + 0.01 + _y2_squared_at_start()), rel=1e-9)
    assert np.all(np.diff(v)[high] < 0.0), "V_y rose on an ideal plant"
    assert float(v[-1]) < 1e-4


def _y2_squared_at_start() -> float:
    """y_2 = v - chi = -alpha_1(0): |beta_1 |x|^2 x + gamma_1 x/|x|^(1/2)|^2, at x = (0.3, -0.2, 0.1)."""
    x, diag = (0.3, -0.2, 0.1), (1.0, 1.0, 1.2)
    size = 0.14
    return math.fsum((d * size * a + d * a / size**0.25) ** 2 for a, d in zip(x, diag, strict=True))
