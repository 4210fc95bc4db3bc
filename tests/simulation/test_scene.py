"""Experiments as files: what they mean, what is refused, and what a scene makes of them."""

import math
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from companion.config.arms_config import Feedforward
from companion.core.interfaces import ConfigError
from companion.simulation.scene import HorizonError, Scene, experiment_names, load_scene
from companion.studies.paper.paper_table import PAPER
from companion.trajectories.reference import Ellipse
from mock_autopilot.px4.attitude_error import AttitudeErrorSource
from tests.simulation.scenes import law_for

FILE = """
title = "a short one"
settle_s = 2.0
arms = "swing"

[trajectory]
curve = "ellipse"
semi_axes_m = [0.8, 0.5]
period_s = 6.0
laps = 1
ramp_s = 2.0
height_m = 1.5

[companion.vehicle]
attitude_bandwidth_radps = 10.0

[companion.mocap]
delay_s = 0.03

[companion.arms]

[mock.plant]
mass_kg = 5.0
attitude_bandwidth_radps = [9.0, 9.5, 3.0]

[mock.vehicle]
attitude_delay_s = 0.025
thrust_delay_s = 0.015

[mock.qualisys]
delay_s = 0.03
noise_m = 0.001
noise_rad = 0.004

[mock.disturbance]
constant_ned_n = [0.4, 0.0, 0.0]

[mock.arms]
enabled = true
"""


def load(folder: Path, *changes: tuple[str, str]) -> Scene:
    text = FILE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "short.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(str(path))


def test_a_file_says_what_is_flown_and_by_what(tmp_path: Path) -> None:
    scene = load(tmp_path)
    assert (scene.name, scene.title, scene.settle_s, scene.period_s) == ("short", "a short one", 2.0, 0.01)
    assert isinstance(scene.trajectory, Ellipse)
    assert scene.trajectory.at(0.0).position_w_m.tolist() == [0.8, 0.0, 1.5]
    mission = scene.mission(0.1)
    assert len(mission.time_s) == round((2.0 + scene.trajectory.duration_s) / 0.01)
    vehicle = scene.vehicle()
    assert vehicle.plant.mass_kg == 5.0
    assert (vehicle.mocap_delay_s, vehicle.attitude_delay_s, vehicle.thrust_delay_s) == (0.03, 0.025, 0.015)
    assert (vehicle.noise_m, vehicle.noise_rad) == (0.001, 0.004)
    assert vehicle.forces.constant_ned_n == (0.4, 0.0, 0.0)
    pilot = scene.pilot(law_for(scene))
    assert pilot.estimator.delay_s == 0.03
    assert pilot.thrust.mass_kg == 4.85, "the companion knows what it is told, not what is"


def test_arms_move_from_the_first_cycle_and_the_law_is_told(tmp_path: Path) -> None:
    scene = load(tmp_path)
    count, arms = len(scene.mission(0.0).time_s), scene.vehicle().arms
    assert arms is not None
    assert len(arms.table.joints_rad) >= 2 * count, "two steps a cycle"
    swung = np.ptp(arms.table.joints_rad, axis=0)
    assert np.degrees(swung[[0, 1, 4, 5]]).min() > 20.0
    law = law_for(scene)
    told = {name: scene.pilot(law, name).feedforward_b_mps2 for name in Feedforward}
    as_configured = scene.pilot(law).feedforward_b_mps2
    assert as_configured is not None
    assert {name: push.shape for name, push in told.items() if push is not None} == dict.fromkeys(told, (count, 3))
    assert np.array_equal(as_configured, told[Feedforward(scene.companion.arms.feedforward)])  # type: ignore[union-attr,arg-type]
    assert not np.any(told[Feedforward.OFF])
    assert np.any(told[Feedforward.FORCE])


def test_px4_trims_the_arms_weight_out_as_quickly_as_its_rate_gains_say(tmp_path: Path) -> None:
    gains = "[mock.px4.params]\nMC_ROLLRATE_I = 0.0\nMC_PITCHRATE_I = 0.5\nMC_PITCHRATE_P = 0.25\n\n[mock.arms]"
    arms = load(tmp_path, ("[mock.arms]", gains)).vehicle().arms
    assert arms is not None
    assert arms.trim_s == (math.inf, 0.5, 2.0), "P / I; PX4's own gains turn about z with 0.2 and 0.1"


def test_without_arms_there_is_nothing_to_tell(tmp_path: Path) -> None:
    scene = load(tmp_path, ('arms = "swing"', 'arms = "off"'))
    assert scene.arms is None
    assert scene.vehicle().arms is None
    assert scene.pilot(law_for(scene)).feedforward_b_mps2 is None


def test_another_bandwidth_is_the_vehicles_and_the_companion_knows(tmp_path: Path) -> None:
    scene = load(tmp_path).with_bandwidth(6.3)
    assert scene.vehicle().plant.attitude_bandwidth_radps == (6.3, 6.3, 3.0)
    assert scene.companion.vehicle_model().attitude_bandwidth_radps == 6.3
    assert scene.vehicle().plant.mass_kg == 5.0, "all else stays"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('curve = "ellipse"', 'curve = "circle"'), "trajectory.curve = 'circle'"),
        (("laps = 1", "laps = 0"), "trajectory.laps = 0"),
        (("settle_s = 2.0", "settel_s = 2.0"), "settel_s: unknown key, did you mean 'settle_s'?"),
        (("noise_m = 0.001", "noise_m = -0.001"), "mock.qualisys.noise_m = -0.001: must be at least 0"),
        (("mass_kg = 5.0", "mas_kg = 5.0"), "mock.plant: unknown key mas_kg"),
        (('arms = "swing"', 'arms = "wave"'), "unknown arm motion 'wave'"),
        (("[companion.arms]", "[companion.armor]"), "companion.armor: unknown key, did you mean 'arms'?"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, change)
    assert said in str(refused.value)


def test_an_unknown_experiment_names_those_there_are() -> None:
    with pytest.raises(ConfigError, match=r"'oval': give a TOML file or one of ellipse, figure8, px4-ellipse"):
        load_scene("oval")


@pytest.mark.parametrize("name", experiment_names())
def test_the_projects_own_experiments_load(name: str) -> None:
    scene = load_scene(name)
    assert (scene.arms is not None) == (name in PAPER), "the paper's experiments swing both arms"
    assert scene.companion.mocap.delay_s == scene.mock.qualisys.delay_s
    law_for(scene)


def test_a_horizon_is_any_that_the_mock_has_or_none() -> None:
    assert {*HorizonError} == {HorizonError.PERFECT, *get_args(AttitudeErrorSource)}
    scene = load_scene("px4-ellipse")
    errors = {kind: scene.with_horizon(kind).vehicle().attitude_error for kind in HorizonError}
    assert [kind for kind, error in errors.items() if not error.present] == [HorizonError.PERFECT]
    assert all(error.source == kind for kind, error in errors.items() if error.present)


def test_only_a_horizon_that_errs_is_corrected_unless_that_is_switched_off() -> None:
    scene = load_scene("px4-ellipse")
    assert scene.corrects
    assert not scene.uncorrected().corrects
    assert not scene.with_horizon(HorizonError.PERFECT).corrects
