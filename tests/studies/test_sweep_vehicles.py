from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from companion.simulation.scene import Scene, load_scene
from companion.studies.sweep.sweep_vehicles import DROPOUTS, Drawn, draw, unseen, vehicles
from mock_autopilot.config import EstimatorConfig
from mock_autopilot.physics.plant import GRAVITY_MPS2, PlantParams, thrust_of_signal
from tests.studies.sweep_rig import short_experiment

SEEDS = st.integers(0, 2**64)
CYCLES, PERIOD_S = 1000, 0.01


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return load_scene(short_experiment(tmp_path_factory.mktemp("scene"))).with_bandwidth(12.0)


def _longest_run(lost: NDArray[np.bool_]) -> int:
    longest = run = 0
    for cycle in lost:
        run = run + 1 if cycle else 0
        longest = max(longest, run)
    return longest


@given(SEEDS)
@settings(max_examples=30)
def test_everything_is_in_its_range(scene: Scene, seed: int) -> None:
    drawn = draw(seed, range(20))
    true = vehicles(scene, drawn, CYCLES)
    mass_kg = np.asarray(true.plant.mass_kg)
    assert ((mass_kg >= 0.8 * 4.0) & (mass_kg <= 1.2 * 4.0)).all()
    hover = mass_kg * GRAVITY_MPS2 / np.asarray(true.plant.max_thrust_n)  # the motors' curve is straight
    assert ((hover >= 0.85 * 0.4 - 1e-12) & (hover <= 1.15 * 0.4 + 1e-12)).all()
    roll, pitch, yaw = np.asarray(true.plant.attitude_bandwidth_radps).T
    assert ((roll >= 0.7 * 12.0) & (roll <= 1.3 * 12.0)).all()
    assert np.array_equal(roll, pitch)
    assert np.allclose(yaw / roll, scene.mock.plant.attitude_bandwidth_radps[2] / 12.0)
    for delay_s in (true.mocap_delay_s, true.attitude_delay_s, true.thrust_delay_s):
        steps = np.asarray(delay_s) / 0.005
        assert np.allclose(steps, np.rint(steps))
        assert ((steps > 1.9) & (steps < 8.1)).all()
    assert ((drawn.disturbance_scale >= 0.5) & (drawn.disturbance_scale <= 1.5)).all()
    noise = np.asarray(true.noise_m) / scene.mock.qualisys.noise_m
    assert ((noise >= 0.5) & (noise <= 3.0)).all()
    assert np.allclose(np.asarray(true.noise_rad) / scene.mock.qualisys.noise_rad, noise)
    assert (np.linalg.norm(true.offset_w_m, axis=-1) <= 0.5).all()


@given(SEEDS)
@settings(max_examples=20)
def test_motion_capture_is_lost_for_a_tenth_of_a_second_at_most(seed: int) -> None:
    drawn = draw(seed, range(10))
    lost = unseen(drawn, CYCLES, PERIOD_S)
    assert lost.shape == (CYCLES, 10)
    assert not lost[0].any()
    assert all(_longest_run(column) <= 10 for column in lost.T)
    begins = (np.diff(lost.astype(int), axis=0) == 1).sum(axis=0)
    assert np.array_equal(begins, (drawn.dropout_s > 0.0).sum(axis=1))
    assert np.array_equal(lost.sum(axis=0), np.rint(drawn.dropout_s / PERIOD_S).sum(axis=1))


def test_drop_outs_at_their_longest_and_latest_do_not_join() -> None:
    nothing = draw(1, [0])
    values = {field.name: getattr(nothing, field.name) for field in fields(Drawn)}
    latest = np.full((1, DROPOUTS), np.nextafter(1.0, 0.0))
    worst = Drawn(**(values | {"dropout_s": np.full((1, DROPOUTS), 0.1), "dropout_begin": latest}))
    lost = unseen(worst, 6 * 11, PERIOD_S)[:, 0]
    assert lost.tolist() == ([False] + [True] * 10) * 6


@given(SEEDS, st.integers(0, 5000), st.integers(1, 5))
@settings(max_examples=30)
def test_a_vehicle_is_the_same_in_any_company(seed: int, index: int, others: int) -> None:
    alone, among = (
        draw(seed, [index]),
        draw(seed, range(index - others, index + others) if index >= others else [index]),
    )
    row = others if index >= others else 0
    for field in fields(Drawn):
        assert np.array_equal(getattr(alone, field.name)[0], getattr(among, field.name)[row]), field.name


def test_vehicles_and_seeds_differ_in_every_number() -> None:
    first, other = draw(1, range(200)), draw(2, range(200))
    for field in fields(Drawn):
        values = getattr(first, field.name)
        assert not np.array_equal(values, getattr(other, field.name)), field.name
        assert len(np.unique(values, axis=0)) >= 7, field.name


def test_the_ranges_are_used_to_their_ends_and_evenly() -> None:
    drawn = draw(3, range(4000))
    for values, low, high in (
        (drawn.mass_share, 0.8, 1.2),
        (drawn.hover_share, 0.85, 1.15),
        (drawn.bandwidth_share, 0.7, 1.3),
        (drawn.disturbance_scale, 0.5, 1.5),
        (drawn.noise_scale, 0.5, 3.0),
        (drawn.attitude_error_rad, 0.005, 0.035),
        (drawn.attitude_error_time_s, 1.0, 20.0),
        (np.linalg.norm(drawn.offset_w_m, axis=-1), 0.0, 0.5),
    ):
        counts, _ = np.histogram(values, bins=10, range=(low, high))
        assert counts.sum() == 4000
        assert np.abs(counts - 400).max() < 5.0 * np.sqrt(400)
    for delay_s in (drawn.mocap_delay_s, drawn.setpoint_delay_s):
        steps, counts = np.unique(np.rint(delay_s / 0.005), return_counts=True)
        assert steps.tolist() == [2, 3, 4, 5, 6, 7, 8]
        assert np.abs(counts - 4000 / 7).max() < 5.0 * np.sqrt(4000 / 7)
    assert np.abs(drawn.offset_w_m.mean(axis=0)).max() < 5.0 * 0.17 / np.sqrt(4000)  # 0.5/3: deviation of an axis
    assert np.abs(np.corrcoef(drawn.mocap_delay_s, drawn.setpoint_delay_s)[0, 1]) < 5.0 / np.sqrt(4000)


def test_a_scene_with_a_perfect_horizon_keeps_it(scene: Scene) -> None:
    drawn = draw(5, range(3))
    true = vehicles(scene, drawn, CYCLES).attitude_error
    assert np.array_equal(np.asarray(true.size_rad), drawn.attitude_error_rad)
    assert np.array_equal(np.asarray(true.time_s), drawn.attitude_error_time_s)
    mock = scene.mock.model_copy(update={"estimator": EstimatorConfig(attitude_error_rad=0.0)})
    assert not vehicles(replace(scene, mock=mock), drawn, CYCLES).attitude_error.present


def test_the_hover_signal_carries_the_weight_whatever_the_motors_curve(scene: Scene) -> None:
    drawn = draw(5, range(9))
    mock = scene.mock.model_copy(update={"plant": PlantParams(motor_curve=0.7)})
    curved = vehicles(replace(scene, mock=mock), drawn, CYCLES).plant
    lift_n = thrust_of_signal(0.4 * drawn.hover_share, curved)
    assert np.allclose(lift_n, np.asarray(curved.mass_kg) * GRAVITY_MPS2)


def test_a_low_flight_begins_above_its_start_and_not_on_the_floor(tmp_path: Path) -> None:
    low = load_scene(short_experiment(tmp_path, height_m=0.6))
    drawn = draw(1, range(100))
    offset_w_m = vehicles(low, drawn, CYCLES).offset_w_m
    assert (0.6 + drawn.offset_w_m[:, 2] < 0.5).sum() > 10
    assert (0.6 + offset_w_m[:, 2] >= 0.5).all()
    assert np.array_equal(offset_w_m[:, :2], drawn.offset_w_m[:, :2])
    assert np.array_equal(np.abs(offset_w_m), np.abs(drawn.offset_w_m))
