"""What practical.toml promises, on the paper's experiments with swinging arms and seeds that no search flew.

The autopilot's horizon is perfect here: the gains were searched for with one.
"""

from functools import cache

import numpy as np
import pytest

from companion.config_controller import load_controller
from companion.experiments.metrics import Score, score
from companion.experiments.mission import stacked
from companion.experiments.paper_table import PAPER, reduced_percent
from companion.experiments.scene import load_scene
from companion.experiments.search import CHECK_SEED
from companion.experiments.simulation import simulate
from tests.experiments.scenes import perfect_horizon

pytestmark = pytest.mark.slow

SEEDS = (1, 2)


@cache
def flown(experiment: str, controller: str, bandwidth_radps: float) -> Score:
    scene = perfect_horizon(load_scene(experiment).with_bandwidth(bandwidth_radps))
    loaded = load_controller(controller, scene.companion.vehicle_model(), scene.period_s)
    mission = stacked([scene.mission(loaded.law.preview_s)] * len(SEEDS))
    return score(simulate(scene.pilot(loaded), scene.vehicle(), mission, SEEDS))


@pytest.mark.parametrize("experiment", list(PAPER))
def test_it_takes_away_at_least_the_papers_share_of_pids_error_in_every_cell(experiment: str) -> None:
    assert max(SEEDS) < CHECK_SEED, "searches begin above that"
    ours, baseline, paper = flown(experiment, "practical", 10.0), flown(experiment, "pid", 10.0), PAPER[experiment]
    for ours_m, baseline_m, wanted in (
        (ours.mean_error_m, baseline.mean_error_m, paper.mean_reduced_percent),
        (ours.max_error_m, baseline.max_error_m, paper.max_reduced_percent),
    ):
        assert (reduced_percent(ours_m.mean(axis=0), baseline_m.mean(axis=0)) >= np.array(wanted)).all()


@pytest.mark.parametrize("experiment", list(PAPER))
@pytest.mark.parametrize(("bandwidth_radps", "error_m", "updates"), [(10.0, 0.015, 0.06), (6.3, 0.02, 0.07)])
def test_it_errs_by_little_and_sends_seldom(
    experiment: str, bandwidth_radps: float, error_m: float, updates: float
) -> None:
    ours = flown(experiment, "practical", bandwidth_radps)
    assert not ours.diverged.any()
    assert ours.error_m.mean() <= error_m
    assert ours.update_share.mean() <= updates
