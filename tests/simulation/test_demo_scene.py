"""The demo as a scene: the legs, the disturbance and the arms of the flight it stands for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig, load_config
from companion.config.locations import default_config_path
from companion.core.interfaces import ConfigError
from companion.simulation.demo_scene import LIFT_OFF_S, LINK_S, demo_scene, load_mock
from companion.simulation.scene import Scene
from companion.trajectories.reference import Ellipse, LapTiming, Trajectory
from companion.trajectories.waypoints import Waypoints
from mock_autopilot.config import MockConfig
from mock_autopilot.physics.disturbance import force_series
from tests.simulation.scenes import law_for

CURVE = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=6.0, laps=1, ramp_s=2.0))


def demo(arms: str = "swing", curve: Trajectory = CURVE) -> Scene:
    mock = load_mock(default_config_path("mock.toml"))
    return demo_scene("ellipse", curve, arms, load_config(default_config_path("demo.toml")), mock)


def test_it_climbs_goes_to_the_start_waits_and_then_flies_the_curve() -> None:
    scene = demo()
    mission = scene.mission(0.0)
    climb_s, way_s, wait_s = 1.875 * 1.18 / 0.5, 1.875 * 1.0 / 0.5, 2.0  # minimum jerk with a peak of 0.5 m/s
    assert 0.0 <= scene.settle_s - (climb_s + way_s + wait_s) < scene.period_s, "whole cycles"
    time_s, position = mission.time_s, mission.now.position_w_m
    assert position[0] == pytest.approx([0.0, 0.0, 0.02], abs=1e-3), "lift-off is 2 cm above the floor"
    above = np.abs(time_s + way_s + wait_s) < 0.006
    assert position[above] == pytest.approx(np.array([[0.0, 0.0, 1.2]] * above.sum()), abs=1e-4)
    waiting = (time_s > -wait_s + 0.01) & (time_s < -1e-6)
    assert (position[waiting] == CURVE.at(0.0).position_w_m).all()
    for row in np.flatnonzero(time_s >= 0.0)[::97]:
        assert position[row] == pytest.approx(CURVE.at(float(time_s[row])).position_w_m, abs=1e-9)
    assert np.abs(np.diff(mission.now.velocity_w_mps, axis=0)).max() < 0.02, "no leg begins with a jump"


def test_a_heading_that_the_trajectory_begins_with_is_turned_to_on_the_way_there() -> None:
    turned = Waypoints(np.array([0.0, 4.0]), np.array([[0.5, 0.0, 1.2], [0.0, 0.5, 1.2]]), np.array([1.5, 2.0]))
    mission = demo("off", turned).mission(0.0)
    yaw_rad = mission.now.yaw_rad
    assert yaw_rad[0] == 0.0, "as it stands on the floor"
    assert yaw_rad[mission.time_s >= 0.0][0] == pytest.approx(1.5, abs=1e-6)
    assert yaw_rad[-1] == pytest.approx(2.0, abs=1e-3)
    assert np.abs(np.diff(yaw_rad)).max() < 0.02, "nowhere at once"


def test_the_arms_stand_until_the_climb_is_over() -> None:
    scene = demo()
    assert scene.arms is not None
    stowed, climb_s = scene.companion.arms.stow_rad(), 1.875 * 1.18 / 0.5  # type: ignore[union-attr]
    motion = scene.arms.trajectory
    assert (motion.at(climb_s).position_rad == stowed).all()
    assert np.abs(motion.at(climb_s + 1.5).position_rad - stowed).max() > 0.1
    assert motion.duration_s > scene.settle_s + CURVE.duration_s, "they move on after the curve"
    assert demo("off").arms is None


def test_the_disturbance_is_the_mocks_as_far_on_its_way_as_at_lift_off() -> None:
    mock = load_mock(default_config_path("mock.toml"))
    as_booted, as_flown = (
        replace(config.disturbance.forces(), noise_n=(0.0, 0.0, 0.0)) for config in (mock, demo().mock)
    )
    step_s = 0.01
    late = round(LIFT_OFF_S / step_s)
    booted, flown = (
        force_series(forces, [np.random.default_rng(0)], step_s, late + 500)[:, 0] for forces in (as_booted, as_flown)
    )
    assert flown[:500] == pytest.approx(booted[late:], abs=1e-9)


def test_transport_adds_to_every_delay() -> None:
    scene = demo("off")
    vehicle, mock = scene.vehicle(), scene.mock
    assert vehicle.mocap_delay_s == pytest.approx(mock.qualisys.delay_s + LINK_S)
    assert vehicle.attitude_delay_s == pytest.approx(mock.vehicle.attitude_delay_s + LINK_S)
    assert vehicle.thrust_delay_s == pytest.approx(mock.vehicle.thrust_delay_s + LINK_S)


def test_it_can_be_flown_with_another_bandwidth() -> None:
    scene = demo().with_bandwidth(12.0)
    assert scene.vehicle().plant.attitude_bandwidth_radps[:2] == (12.0, 12.0)
    law_for(scene)


def test_what_cannot_be_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="arms 'swing': the mock's configuration has none"):
        demo_scene("x", CURVE, "swing", load_config(default_config_path("demo.toml")), MockConfig.from_dict({}))
    with pytest.raises(ConfigError, match=r"arms swing: this vehicle has no arms"):
        demo_scene("x", CURVE, "swing", CompanionConfig(), load_mock(default_config_path("mock.toml")))
    broken = tmp_path / "mock.toml"
    broken.write_text("[plant]\nmas_kg = 3.0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"mock\.toml: plant: unknown key mas_kg"):
        load_mock(broken)
