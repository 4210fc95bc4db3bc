"""The frozen disturbances: PID errs as the paper's did; and how they are adjusted and written."""

import tomllib

import numpy as np
import pytest

from companion.config.controller_config import load_controller
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.scene import load_scene
from companion.simulation.simulation import simulate
from companion.studies.paper.calibration import SEEDS, Calibrated, disturbance_toml, scaled
from companion.studies.paper.paper_table import PAPER, PID_WITHIN, beside_paper
from mock_autopilot.config import MockConfig
from mock_autopilot.physics.disturbance import Forces, Sinusoid

pytestmark = pytest.mark.slow

OTHER_SEEDS = (1, 2, 3)
FORCES = Forces(
    (0.4, -0.3, 0.0), (Sinusoid((1.4, 0.0, 0.0), 9.0), Sinusoid((0.0, 1.1, 0.5), 13.0, 1.0)), (0.2, 0.2, 0.2)
)


@pytest.mark.parametrize("name", list(PAPER))
def test_under_the_frozen_disturbances_pid_errs_as_the_papers(name: str) -> None:
    assert not set(OTHER_SEEDS) & set(SEEDS)
    scene = load_scene(name)
    controller = load_controller("pid", scene.companion.vehicle_model(), scene.period_s)
    mission = stacked([scene.mission(0.0)] * len(OTHER_SEEDS))
    flown = score(simulate(scene.pilot(controller), scene.vehicle(), mission, OTHER_SEEDS))
    assert (np.abs(beside_paper(flown.mean_error_m.mean(axis=0), PAPER[name])) <= PID_WITHIN).all()


def test_an_axis_is_scaled_as_a_whole() -> None:
    twice_x = scaled(FORCES, np.array([2.0, 1.0, 0.5]))
    assert twice_x.constant_ned_n == (0.8, -0.3, 0.0)
    assert twice_x.noise_n == (0.4, 0.2, 0.1)
    assert [wave.amplitude_ned_n for wave in twice_x.sinusoids] == [(2.8, 0.0, 0.0), (0.0, 1.1, 0.25)]
    assert [(wave.period_s, wave.phase_rad) for wave in twice_x.sinusoids] == [(9.0, 0.0), (13.0, 1.0)]


def test_what_is_written_is_what_was_found() -> None:
    text = disturbance_toml(Calibrated(FORCES, np.array([0.08, 0.07, 0.04])))
    assert "0.0800, 0.0700, 0.0400" in text
    assert MockConfig.from_dict(tomllib.loads(text)["mock"]).disturbance.forces() == FORCES
