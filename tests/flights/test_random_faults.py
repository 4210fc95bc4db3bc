"""Random fault schedules, three of those that `make faults` flies, one by a law on the ground."""

import multiprocessing

import pytest

from tests.flights.faults.schedules import SPLIT_FROM, faults_of, fly_schedule

pytestmark = pytest.mark.slow

SEEDS = (0, 1, SPLIT_FROM + 2)


def test_a_seed_is_a_schedule() -> None:
    assert faults_of(3) == faults_of(3)
    assert len({faults_of(seed) for seed in range(120)}) == 120


def test_every_schedule_ends_on_the_ground_or_with_a_pilot_inside_the_fence() -> None:
    with multiprocessing.Pool() as workers:
        outcomes = workers.map(fly_schedule, SEEDS, chunksize=1)
    assert [outcome for outcome in outcomes if outcome.problems] == []
