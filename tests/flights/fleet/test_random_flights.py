"""Several vehicles fly at random and keep apart: a few seeds; `python -m tests.flights.fleet` flies more."""

import random
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.separation_config import SeparationConfig
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.room_check import check_trajectory
from tests.flights.fleet.judge import EVERY, STEP_S, Judge, Limit
from tests.flights.fleet.operator import HALF_M, Operator
from tests.flights.fleet.plan import Incident, Trouble, incidents_of
from tests.flights.fleet.virtual import Order, fly_seed, limit_of
from tests.mock_autopilot.qtm.truths import truth_at

FLOWN = (
    Order(1, 2, 32.0, incidents=(Incident(15.0, 0, Trouble.FREEZES),)),
    Order(2, 2, 40.0, incidents=(Incident(12.0, 1, Trouble.BODY_LOST), Incident(22.0, 0, Trouble.SILENT))),
)


@pytest.mark.slow
@pytest.mark.parametrize("order", FLOWN, ids=lambda order: str(order.incidents[0].trouble))
def test_two_that_fly_at_random_keep_apart_also_when_one_fails(order: Order) -> None:
    outcome = fly_seed(order)
    assert outcome.problems == []
    assert len(outcome.incidents) == len(order.incidents)
    assert outcome.counts["takeoff accepted"] >= 2
    assert outcome.counts["move accepted"] >= 2
    assert outcome.flown_m > 8.0
    assert 0.0 < outcome.closest.clearance_m < 3.0


def test_the_incidents_of_a_seed_are_always_the_same() -> None:
    for seed in range(50):
        incidents = incidents_of(seed, 3, 300.0)
        assert incidents == incidents_of(seed, 3, 300.0)
        assert all(20.0 <= one.at_s <= 285.0 and 0 <= one.vehicle < 3 for one in incidents)
        assert all(one.at_s > 200.0 for one in incidents if one.trouble is Trouble.FREEZES)
    kinds = {one.trouble for seed in range(50) for one in incidents_of(seed, 3, 300.0)}
    assert kinds == set(Trouble)


def test_an_operators_tracks_are_such_as_the_service_accepts() -> None:
    operator, room = Operator(random.Random(1), lambda: [(0.0, 0.0, 1.0)], 60.0), CompanionConfig().room
    drawn = [operator._something() for _ in range(150)]
    tracks = [one.trajectory for one in drawn if isinstance(one, TrackRequest)]
    for trajectory in tracks:
        check_trajectory(trajectory, room, "drawn")
    ends = np.array([trajectory.at(0.0).position_w_m for trajectory in tracks])
    assert np.abs(ends[:, :2]).max() <= HALF_M
    assert np.abs(ends[:, :2]).max() > 0.9 * HALF_M
    assert any(np.hypot(*end[:2]) < 0.4 for end in ends)  # at the other vehicle


LIMIT = Limit(1.2, 1.6, 1.0)


def test_the_limits_are_the_configurations() -> None:
    separation = SeparationConfig(radius_m=1.3, height_m=1.7, parked_height_m=1.1)
    assert limit_of(CompanionConfig(separation=separation)) == Limit(1.3, 1.7, 1.1)


class _Stub:
    """Two vehicles without a room: their places and phases as a test says."""

    def __init__(self) -> None:
        flying = SimpleNamespace(flight=SimpleNamespace(airborne=True, reason=""), events=())
        flights = [SimpleNamespace(phase=Phase.HOLD, loop=flying) for _ in range(2)]
        self.worlds = [SimpleNamespace(position_ned_m=(0.0, 0.0, 0.0)) for _ in range(2)]
        room = SimpleNamespace(fleet=SimpleNamespace(names=("a", "b"), worlds=self.worlds))
        self.fleet: Any = SimpleNamespace(room=room, flights=flights)
        operators = [Operator(random.Random(1), list, 60.0) for _ in range(2)]
        self.judge = Judge(cast(Any, self.fleet), operators, LIMIT)
        self.time_s = 0.0

    def look(self, *places: tuple[float, float, float], stands: bool = False, for_s: float = EVERY * STEP_S) -> None:
        """Let the judge look at places (NED, m) for a while; `stands`: those at height 0 are on the ground."""
        for _ in range(round(for_s / STEP_S)):
            self.time_s += STEP_S
            for world, place in zip(self.worlds, places, strict=True):
                world.position_ned_m = place
            truths = [truth_at(self.time_s, place) for place in places]
            self.judge.look(
                tuple(truth._replace(on_ground=stands and truth.position_ned_m[2] == 0.0) for truth in truths)
            )


def test_the_judge_sees_separation_lost_once_and_how_deep() -> None:
    stub = _Stub()
    for apart_m in (2.0, 1.1, 0.9, 1.0, 1.3, 1.1):
        stub.look((0.0, 0.0, -1.0), (apart_m, 0.0, -1.0))
    assert [round(one.clearance_m, 3) for one in stub.judge.lost] == [-0.3, -0.1]
    assert stub.judge.closest.clearance_m == pytest.approx(-0.3)
    assert stub.judge.closest.pair == ("a", "b")


@pytest.mark.parametrize(
    ("above_m", "stands", "lost"), [(1.5, False, True), (1.7, False, False), (0.9, True, True), (1.1, True, False)]
)
def test_the_judge_knows_the_height_above_one_that_flies_and_one_that_stands(
    above_m: float, stands: bool, lost: bool
) -> None:
    stub = _Stub()
    down_m = 0.0 if stands else -0.8
    stub.look((0.0, 0.0, down_m - above_m), (0.5, 0.0, down_m), stands=stands)
    assert bool(stub.judge.lost) is lost


def test_two_on_the_ground_are_not_too_near() -> None:
    stub = _Stub()
    stub.look((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), stands=True)
    assert not stub.judge.lost


def test_the_judge_counts_how_long_one_waits_in_its_place() -> None:
    stub = _Stub()
    stub.look((0.0, 0.0, -1.0), (3.0, 0.0, -1.0), for_s=4.0)
    stub.look((0.0, 0.0, -1.0), (3.5, 0.0, -1.0), for_s=4.0)
    assert stub.judge.blocked.body == "a"
    assert stub.judge.blocked.for_s == pytest.approx(8.0, abs=0.05)
    stub.fleet.flights[0].phase = Phase.LAND
    stub.look((0.0, 0.0, -1.0), (4.0, 0.0, -1.0), for_s=4.0)
    assert stub.judge.blocked.for_s == pytest.approx(8.0, abs=0.05)
