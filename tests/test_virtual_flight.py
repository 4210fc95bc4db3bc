"""Flights in virtual time: the law that flies against the simulated plant with the recorded attitude lag."""

from dataclasses import dataclass

import numpy as np
import pytest

from companion.config import CompanionConfig
from companion.config_controller import load_controller
from companion.control.reference import Ellipse, FigureEight, LapTiming, Trajectory
from companion.experiments.virtual_flight import VirtualRoom, fly
from companion.types import Array

CENTRE = np.array([0.0, 0.0, 1.2])
LAP = LapTiming(period_s=15.0, laps=1)


@dataclass(frozen=True)
class Flown:
    mean_m: Array
    max_m: Array
    updates: float


def flown(controller: str, trajectory: Trajectory, seed: int = 0) -> Flown:
    law = load_controller(controller, CompanionConfig().vehicle_model(), 0.01).law
    samples = [sample for sample in fly(law, trajectory, VirtualRoom(seed=seed)) if sample.time_s >= 0.0]
    error = np.abs([sample.position_w_m - sample.reference.position_w_m for sample in samples])
    updates = float(np.mean([sample.output.event for sample in samples]))
    return Flown(error.mean(axis=0), error.max(axis=0), updates)


@pytest.mark.parametrize("trajectory", [Ellipse(CENTRE, timing=LAP), FigureEight(CENTRE, timing=LAP)])
def test_the_law_that_flies_beats_the_baseline_on_every_axis_with_a_tenth_of_its_messages(
    trajectory: Trajectory,
) -> None:
    ours, baseline = flown("etnn", trajectory), flown("pid", trajectory)
    assert (ours.mean_m <= 0.02).all()
    assert (ours.max_m <= 0.08).all()
    assert (ours.mean_m < 0.3 * baseline.mean_m).all(), f"{ours.mean_m} against {baseline.mean_m}"
    assert ours.updates <= 0.10
    assert baseline.updates == 1.0


def test_the_same_seed_gives_the_same_flight_to_the_last_bit() -> None:
    law = load_controller("etnn", CompanionConfig().vehicle_model(), 0.01).law
    short = Ellipse(CENTRE, timing=LapTiming(period_s=4.0, laps=1))
    tracks = [
        b"".join(sample.position_w_m.tobytes() for sample in fly(law, short, VirtualRoom(seed=seed)))
        for seed in (5, 5, 6)
    ]
    assert tracks[0] == tracks[1]
    assert tracks[0] != tracks[2]


def test_a_batch_flies_as_each_vehicle_would_alone() -> None:
    law = load_controller("etnn", CompanionConfig().vehicle_model(), 0.01).law
    quiet = VirtualRoom(position_noise_m=0.0, attitude_noise_rad=0.0, rate_noise_radps=0.0)
    short = Ellipse(CENTRE, timing=LapTiming(period_s=4.0, laps=1))
    offsets = np.array([[0.0, 0.0, 0.0], [0.2, -0.1, 0.1]])
    batch = [sample.position_w_m for sample in fly(law, short, quiet, lead=(2,), offset_w_m=offsets)]
    for row, offset in enumerate(offsets):
        alone = [sample.position_w_m for sample in fly(law, short, quiet, offset_w_m=offset)]
        assert np.allclose([positions[row] for positions in batch], alone, atol=1e-6)
