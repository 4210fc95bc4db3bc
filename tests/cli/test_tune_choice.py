"""Check at the end of a search: where it flies, and which centre is written."""

import numpy as np

from companion.cli.studies.tune import Checked, best_of, elsewhere, verdict
from companion.simulation.scene import load_scene
from companion.studies.tuning.gain_space import START, shares_of
from companion.studies.tuning.search import Centre
from companion.studies.tuning.tuning import WORST_M, shortened


def _checked(error_m: float, update_share: float, worst_m: float = 0.1, **changed: float) -> Checked:
    values = START | changed
    return Checked(Centre(shares_of(values), 1.0, 10), values, error_m, 0.03, worst_m, update_share)


def test_the_nearest_to_what_is_reached_for_is_written() -> None:
    near, far, frugal = _checked(0.011, 0.05), _checked(0.03, 0.05), _checked(0.02, 0.03)
    assert best_of([far, near, frugal]) is near


def test_what_lost_a_vehicle_or_would_be_refused_is_never_written() -> None:
    lost, refused = _checked(0.001, 0.01, worst_m=WORST_M), _checked(0.001, 0.01, filter_eps=0.2, rho=0.3)
    assert best_of([lost, refused]) is None
    held = _checked(0.05, 0.2)
    assert best_of([lost, held, refused]) is held


def test_a_search_is_told_whether_it_is_better_than_what_flies() -> None:
    flies, better, worse = _checked(0.012, 0.05), _checked(0.011, 0.05), _checked(0.02, 0.2, worst_m=0.304)
    assert verdict(better, flies, "practical") == (
        "the best of this search is better than practical (worst case 10.0 cm, practical 10.0 cm)"
    )
    assert "NOT better than practical (worst case 30.4 cm" in verdict(worse, flies, "practical")


def test_the_check_flies_curves_that_no_search_has_flown() -> None:
    for name in ("ellipse", "figure8"):
        trained = shortened(load_scene(name))
        checked = elsewhere(trained)
        times_s = np.linspace(0.0, 15.0, 16)
        there = np.array([checked.trajectory.at(float(t)).position_w_m for t in times_s])
        here = np.array([trained.trajectory.at(float(t)).position_w_m for t in times_s])
        assert np.abs(there - here).max() > 0.3
        assert (there[:, 2] == here[:, 2]).all(), "at the same height"
