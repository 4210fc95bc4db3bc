"""Random fault schedules, two of the hundred that `make faults` flies."""

import multiprocessing

import pytest

from tests.flights.faults.schedules import faults_of, fly_schedule

pytestmark = pytest.mark.slow

SEEDS = range(2)


def test_a_seed_is_a_schedule() -> None:
    assert faults_of(3) == faults_of(3)
    assert len({faults_of(seed) for seed in range(100)}) == 100


def test_every_schedule_ends_on_the_ground_or_with_a_pilot_inside_the_fence() -> None:
    with multiprocessing.Pool() as workers:
        outcomes = workers.map(fly_schedule, SEEDS, chunksize=1)
    assert [outcome for outcome in outcomes if outcome.problems] == []
