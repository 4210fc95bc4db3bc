"""V along flights on the ideal plant: it falls wherever the theorem says so, and is where it says in time."""

from dataclasses import dataclass

import numpy as np
import pytest

from companion.control.gains import EtnnGains
from companion.core.types import Array
from companion.studies.theory.fixed_time import FixedTimeBound, fixed_time_bound
from companion.studies.theory.lyapunov import Lyapunov, fit_ideal_output_weights, lyapunov_of, measured_bounds
from companion.trajectories.reference import Ellipse, Hold
from tests.control.ideal_plant import Run, simulate

CENTRE = np.array([0.0, 0.0, 1.2])
ELLIPSE = Ellipse(CENTRE)
STABILISED = EtnnGains(filter_eps=0.03, zeta=1.0, rho=1.0)
DEAF = {"gamma_v0": np.zeros(4), "gamma_v1": np.zeros(5)}
DT_S = 0.001
VISCOUS_PER_S = 0.15


@dataclass(frozen=True)
class Judged:
    run: Run
    v: Lyapunov
    bound: FixedTimeBound


def judged(run: Run, gains: EtnnGains, friction: Array | None = None, lipschitz_per_s: float = 0.0) -> Judged:
    """V of a run and the bound on it, with ideal weights fitted to a friction at the reference velocities."""
    s = run.signals
    ideal = fit_ideal_output_weights(s["v0"][-1], s["velocity_ref"], friction, gains) if friction is not None else None
    bounds = measured_bounds(s, s["velocity_ref"], delta_mps2=0.0, lipschitz_per_s=lipschitz_per_s, ideal=ideal)
    return Judged(run, lyapunov_of(s, gains, ideal), fixed_time_bound(gains, bounds))


def assert_the_theorem_holds(flight: Judged) -> None:
    """Down at every step above the bound, below it within T_bound and for good; and the position with it."""
    v, bound = flight.v.total, flight.bound
    assert bound.applies
    high = v[:-1] > bound.v_bound
    assert high[0], "the flight must begin outside to show anything"
    assert np.all(np.diff(v)[high] < 0.0), "V rose above its bound"
    inside = int(np.argmin(v > bound.v_bound))
    assert inside * DT_S < bound.settling_time_s
    assert np.all(v[inside:] <= bound.v_bound)
    assert float(np.linalg.norm(flight.run.error_m[inside:], axis=-1).max()) <= bound.position_m


@pytest.fixture(scope="module")
def from_near() -> Judged:
    gains = STABILISED.model_copy(update=DEAF)
    return judged(simulate(gains, Hold(CENTRE), 3.0, offset_m=(0.3, -0.2, 0.1)), gains)


def test_from_thirty_centimetres_v_falls_to_its_bound(from_near: Judged) -> None:
    assert_the_theorem_holds(from_near)
    assert from_near.bound.v_bound < 5e-4
    assert from_near.bound.settling_time_s == pytest.approx(14.0, abs=0.1)


def test_below_the_bound_v_falls_on_to_the_chatter_of_sgn(from_near: Judged) -> None:
    v = from_near.v.total
    assert np.all(np.diff(v)[v[:-1] > 1e-4] < 0.0)
    assert float(v[-1]) < 1e-5


def test_from_two_metres_on_the_ellipse_with_friction_and_a_learning_network() -> None:
    """f = -0.15 p', so L_f = 0.15; what is learnt is f at p_d', what is not is S and the residual of the fit."""
    gains = STABILISED.model_copy(update={"gamma_v0": np.full(4, 2.0), "gamma_v1": np.full(5, 2.0)})
    run = simulate(gains, ELLIPSE, 4.0, offset_m=(2.0, -1.0, 1.0), friction=lambda v: -VISCOUS_PER_S * v, too_far_m=3.0)
    flight = judged(run, gains, -VISCOUS_PER_S * run.signals["velocity_ref"], VISCOUS_PER_S)
    assert_the_theorem_holds(flight)
    assert float(flight.v.weights1[-1]) > 0.1, "nothing in V' makes the weights' part fall: it is bounded, no more"


def test_as_printed_v_grows_and_the_theorem_says_that_it_does_not_apply() -> None:
    gains = EtnnGains().model_copy(update=DEAF)
    flight = judged(simulate(gains, Hold(CENTRE), 12.0, offset_m=(0.1, 0.1, 0.1)), gains)
    assert flight.run.left_at_s is not None
    assert not flight.bound.applies
    assert [c.name for c in flight.bound.conditions if not c.holds] == ["rho/filter_eps against k + s"]
    v = flight.v.total
    assert float(v[-1]) > 10.0 * float(v[0])
    assert float(flight.v.iota1[-1]) > 100.0 * float(flight.v.y1.max()), "it is iota_1 that grows"
