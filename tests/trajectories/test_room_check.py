"""Limits that a trajectory must meet before it is flown: room, speed, acceleration, and those of its heading."""

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import RoomConfig
from companion.core.interfaces import ConfigError
from companion.service.trajectory_space import check_room_and_fence
from companion.supervisor.flight_state import FlightRules
from companion.trajectories.reference import Hold, MinimumJerk
from companion.trajectories.room_check import check_trajectory, instants_s
from companion.trajectories.waypoints import Waypoints

ROOM = RoomConfig()


def path(*rows: tuple[float, float, float]) -> Waypoints:
    """Rows of t (s), x (m), heading (rad), at 1.2 m."""
    times, x, yaws = np.array(rows).T
    return Waypoints(times, np.stack((x, np.zeros_like(x), np.full_like(x, 1.2)), axis=-1), yaws)


@pytest.mark.parametrize(
    ("trajectory", "said"),
    [
        (
            path((0, 0, 0), (0.3, 0, 3), (6, 0, 3)),
            "it: turns too fast: 18.69 rad/s at 0.15 s, allowed is 1.5 (room.max_yaw_rate_radps)",
        ),
        (path((0, 0, 0), (4, 0.5, 0), (4.2, 0.5, 1.5708), (8, 0, 1.5708)), "it: turns too fast: 14."),
        (
            path((0, 0, 0), (1, 0, 0.7), (6, 0, 0.7)),
            "it: turns too sharply: 4.0",
        ),
        (path((0, 0, 0), (1, 2, 0), (6, 2, 0)), "it: too fast: 3."),
        (path((0, 0, 0), (0.01, 1, 0)), "it: too fast: 187.50 m/s at 0.01 s, allowed is 2 (room.max_speed_mps)"),
        (path((0, 0, 0), (0.01, 0, 0.1)), "it: turns too fast: 17.98"),
        (
            MinimumJerk(
                start_w_m=np.zeros(3) + 1.0,
                end_w_m=np.zeros(3) + 1.0,
                duration_s=1.0,
                start_yaw_rad=0.0,
                end_yaw_rad=3.0,
            ),
            "it: turns too fast: 5.6",
        ),
    ],
)
def test_what_no_vehicle_can_follow_is_refused_with_the_instant_and_the_key(
    trajectory: Waypoints | MinimumJerk, said: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        check_trajectory(trajectory, ROOM, "it")
    assert str(caught.value).startswith(said)


def test_a_heading_that_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match="turns too fast: nan"):
        check_trajectory(
            MinimumJerk(
                start_w_m=np.ones(3), end_w_m=np.ones(3), duration_s=2.0, start_yaw_rad=0.0, end_yaw_rad=np.nan
            ),
            ROOM,
            "it",
        )


def test_a_gentle_turn_and_one_over_the_half_turn_are_flown() -> None:
    check_trajectory(path((0, 0, 3.0), (3, 0, -3.0), (9, 0, 0.0)), ROOM, "it")
    check_trajectory(Hold(np.ones(3), 3.0), ROOM, "it")


async def test_in_pieces_nothing_of_the_heading_is_overlooked() -> None:
    """The service looks at a few instants at a time, so that its control loop goes on."""
    for begin_s in np.arange(5.0, 5.4, 0.03):
        sharp = path((0, 0, 0), (begin_s, 0, 0), (begin_s + 0.2, 0, 0.05), (9, 0, 0.05))
        with pytest.raises(ConfigError, match="turns too sharply: "):
            await check_room_and_fence(sharp, CompanionConfig().room, CompanionConfig().fence)


def test_each_segment_is_looked_at_however_short_it_is() -> None:
    times_s = instants_s(path((0, 0, 0), (0.01, 0, 0), (5.0, 0, 0)))
    assert (times_s < 0.01).sum() == 8
    assert np.diff(times_s).min() > 1e-4


def test_on_the_way_to_a_place_it_moves_no_faster_than_a_trajectory_may() -> None:
    careful = CompanionConfig(room=RoomConfig(max_speed_mps=0.2, max_accel_mps2=0.1)).flight_rules()
    assert (careful.climb_speed_mps, careful.climb_accel_mps2) == (0.2, 0.1)
    usual = CompanionConfig().flight_rules()
    assert (usual.climb_speed_mps, usual.climb_accel_mps2) == (0.5, FlightRules.climb_accel_mps2)


@pytest.mark.parametrize(("limit", "wanted"), [(0.2, 0.2), (2.5, FlightRules.turn_radps)])
def test_on_the_way_to_a_place_it_turns_no_faster_than_a_trajectory_may(limit: float, wanted: float) -> None:
    config = CompanionConfig(room=RoomConfig(max_yaw_rate_radps=limit, max_yaw_accel_radps2=limit))
    assert config.flight_rules().turn_radps == wanted
    assert config.flight_rules().turn_accel_radps2 == wanted
