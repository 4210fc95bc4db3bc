"""Motion of the other vehicles: followed, not fooled by a jump, carried on while unseen, and parked or not."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from companion.core.types import MocapFrame, OtherBody, OtherVehicle, Vec3
from companion.estimation import estimator, others
from companion.estimation.estimator import EstimatorState, Verdict
from companion.estimation.others import OtherTrack
from companion.estimation.params import EstimatorParams
from companion.records.exact_json import of_json, to_json

PARAMS = EstimatorParams()
DT_S = 0.01
Place = Vec3 | None


def followed(places: Iterable[Place], tracks: tuple[OtherTrack, ...] = (), from_s: float = 100.0) -> OtherVehicle:
    """Return the vehicle after frames of these places, one every 10 ms."""
    return vehicle_of(*tracked(places, tracks, from_s))


def tracked(
    places: Iterable[Place], tracks: tuple[OtherTrack, ...] = (), from_s: float = 100.0
) -> tuple[tuple[OtherTrack, ...], float]:
    stamp_s = from_s
    for number, place in enumerate(places):
        stamp_s = from_s + number * DT_S
        tracks = others.step(tracks, (OtherBody("two", place),), stamp_s, PARAMS)
    return tracks, stamp_s


def vehicle_of(tracks: tuple[OtherTrack, ...], stamp_s: float) -> OtherVehicle:
    (vehicle,) = others.vehicles_of(tracks, stamp_s)
    return vehicle


def flown(seconds_s: float, velocity: Vec3 = (1.0, 0.0, 0.0), at: Vec3 = (0.0, 0.0, 1.0)) -> list[Place]:
    """Places of a straight flight."""
    (x, y, z), (vx, vy, vz) = at, velocity
    times_s = [k * DT_S for k in range(round(seconds_s / DT_S) + 1)]
    return [(x + vx * t, y + vy * t, z + vz * t) for t in times_s]


def test_before_it_was_seen_nothing_is_known() -> None:
    vehicle = followed([None, None])
    assert math.isinf(vehicle.unseen_s)
    assert not vehicle.known
    assert all(math.isnan(number) for number in (*vehicle.position_w_m, *vehicle.velocity_w_mps))
    assert others.vehicles_of((), 1.0) == ()


def test_the_first_position_counts_at_once_and_the_velocity_soon() -> None:
    assert followed(flown(0.0)) == OtherVehicle(
        body="two", position_w_m=(0.0, 0.0, 1.0), velocity_w_mps=(0.0, 0.0, 0.0)
    )
    vehicle = followed(flown(0.3))
    assert vehicle.velocity_w_mps == pytest.approx((1.0, 0.0, 0.0), abs=0.02)
    assert vehicle.position_w_m == pytest.approx((0.3, 0.0, 1.0), abs=0.001)


def test_noise_moves_one_that_hovers_by_little() -> None:
    rng = np.random.default_rng(3)
    noisy = [(float(x), float(y), 1.0 + float(z)) for x, y, z in rng.normal(0.0, PARAMS.noise_m, (400, 3))]
    tracks, stamp_s = tracked(noisy[:100])
    speeds = []
    for number, place in enumerate(noisy[100:]):
        tracks, now_s = tracked([place], tracks, stamp_s + (number + 1) * DT_S)
        speeds.append(math.hypot(*vehicle_of(tracks, now_s).velocity_w_mps))
    assert max(speeds) < 0.08


def test_unseen_it_flies_on_for_half_a_second_and_then_it_has_stopped() -> None:
    tracks, stamp_s = tracked(flown(1.0))
    lost, later_s = tracked([None] * 20, tracks, stamp_s + DT_S)
    for given in (tracks, lost):
        vehicle = vehicle_of(given, later_s)
        assert vehicle.unseen_s == pytest.approx(0.2)
        assert vehicle.position_w_m[0] == pytest.approx(1.2, abs=0.01)
        assert vehicle.velocity_w_mps[0] == pytest.approx(1.0, abs=0.02)
    gone = vehicle_of(tracks, stamp_s + 5.0)
    assert gone.position_w_m[0] == pytest.approx(1.5, abs=0.02)
    assert gone.velocity_w_mps == (0.0, 0.0, 0.0)
    assert gone.unseen_s == pytest.approx(5.0)
    assert vehicle_of(tracks, stamp_s - 1.0).unseen_s == 0.0, "a clock that goes back"


def test_one_that_was_lost_for_a_second_is_found_again_elsewhere_at_once() -> None:
    tracks, stamp_s = tracked(flown(1.0))
    back, now_s = tracked([(3.0, 2.0, 1.0)], tracks, stamp_s + PARAMS.max_gap_s + 0.1)
    assert vehicle_of(back, now_s).position_w_m == (3.0, 2.0, 1.0)
    soon, now_s = tracked([(1.5, 0.0, 1.0)], tracks, stamp_s + 0.5)
    assert vehicle_of(soon, now_s).unseen_s == 0.0, "where it was expected"


def test_a_jump_is_not_believed_until_ten_frames_agree() -> None:
    """A reflection, or two bodies whose names were swapped."""
    tracks, stamp_s = tracked(flown(1.0))
    jumped, now_s = tracked([(-2.0, 0.0, 1.0)] * 9, tracks, stamp_s + DT_S)
    before = vehicle_of(jumped, now_s)
    assert before.position_w_m[0] == pytest.approx(1.09, abs=0.01)
    assert before.unseen_s == pytest.approx(0.09)
    agreed, now_s = tracked([(-2.0, 0.0, 1.0)], jumped, now_s + DT_S)
    assert vehicle_of(agreed, now_s).position_w_m == (-2.0, 0.0, 1.0)


def test_places_that_do_not_agree_move_nobody() -> None:
    tracks, stamp_s = tracked(flown(1.0))
    scattered: list[Place] = [(-2.0 - 0.1 * k, 0.0, 1.0) for k in range(40)]
    wild, now_s = tracked(scattered, tracks, stamp_s + DT_S)
    assert vehicle_of(wild, now_s).unseen_s == pytest.approx(0.4)
    back, now_s = tracked([(1.41, 0.0, 1.0)], wild, now_s + DT_S)
    assert vehicle_of(back, now_s).unseen_s == 0.0
    assert back[0].agreeing == 0


def test_a_stamp_that_goes_back_a_little_changes_nothing_and_far_begins_again() -> None:
    tracks, stamp_s = tracked(flown(1.0))
    assert tracked([(0.5, 0.0, 1.0)], tracks, stamp_s - 0.5)[0] == tracks
    assert tracked([(1.0, 0.0, 1.0)], tracks, stamp_s)[0] == tracks
    again, now_s = tracked([(0.5, 0.0, 1.0)], tracks, stamp_s - 50.0)
    assert vehicle_of(again, now_s).position_w_m == (0.5, 0.0, 1.0)


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "seconds_s", "parked"),
    [
        (0.1, 0.0, 1.05, True),
        (0.1, 0.0, 0.9, False),
        (0.34, 0.0, 2.0, True),
        (0.36, 0.0, 2.0, False),
        (0.1, 0.12, 2.0, False),
        (1.2, 0.0, 2.0, False),
    ],
)
def test_one_that_stands_on_the_ground_for_a_second_is_parked(
    height_m: float, climb_mps: float, seconds_s: float, parked: bool
) -> None:
    assert followed(flown(seconds_s, (climb_mps, 0.0, 0.0), (0.0, 0.0, height_m))).parked is parked


def test_parked_it_stays_so_while_it_is_not_seen_and_not_once_it_moves() -> None:
    tracks, stamp_s = tracked(flown(2.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1)))
    assert vehicle_of(tracks, stamp_s + 30.0).parked
    reflected, now_s = tracked([(2.0, 0.0, 1.0)], tracks, stamp_s + DT_S)
    assert vehicle_of(reflected, now_s).parked
    climbs, now_s = tracked(flown(0.4, (0.0, 0.0, 0.5), (0.0, 0.0, 0.1)), tracks, stamp_s + DT_S)
    assert not vehicle_of(climbs, now_s).parked


def test_two_are_followed_by_their_names_whatever_their_order() -> None:
    two, three = OtherBody("two", (1.0, 0.0, 1.0)), OtherBody("three", (0.0, 2.0, 1.0))
    tracks = others.step((), (two, three), 1.0, PARAMS)
    tracks = others.step(tracks, (three, two), 1.01, PARAMS)
    assert [(one.body, one.position_w_m) for one in others.vehicles_of(tracks, 1.01)] == [
        ("three", three.position_w_m),
        ("two", two.position_w_m),
    ]


# --- beside the vehicle's own estimate ---


def frame(
    number: int, others_seen: tuple[OtherBody, ...], place: Vec3 = (0.0, 0.0, 1.0), back_s: float = 0.0
) -> MocapFrame:
    stamp_s = 50.0 + number * DT_S
    return MocapFrame(
        frame=number,
        stamp_s=stamp_s - back_s,
        received_s=stamp_s + 0.01,
        position_w_m=np.array(place) + 1e-5 * number,
        rotation_w_b=np.eye(3),
        residual_m=0.001,
        others=others_seen,
    )


def estimated(frames: Iterable[MocapFrame]) -> EstimatorState:
    state = EstimatorState()
    for one in frames:
        state = estimator.step(state, one, PARAMS)
    return state


SEEN = (OtherBody("two", (3.0, 0.0, 1.0)), OtherBody("three", None))


def test_the_vehicles_state_has_the_others_at_the_same_instant() -> None:
    state = estimated(frame(k, SEEN) for k in range(5))
    assert state.vehicle is not None
    two, three = state.vehicle.others
    assert (two.body, two.position_w_m, two.unseen_s) == ("two", (3.0, 0.0, 1.0), 0.0)
    assert not three.known
    assert others.vehicles_of(state.others, state.others_s) == state.vehicle.others


def test_the_others_are_followed_while_the_own_body_is_not_seen() -> None:
    state = estimated(frame(k, SEEN) for k in range(5))
    moved = (OtherBody("two", (3.01, 0.0, 1.0)), SEEN[1])
    lost = estimator.step(state, frame(5, moved, (math.nan,) * 3), PARAMS)
    assert lost.verdict is Verdict.UNTRACKED
    assert lost.vehicle is state.vehicle
    assert others.vehicles_of(lost.others, lost.others_s)[0].position_w_m[0] > 3.0


def test_a_wrong_stamp_moves_no_other() -> None:
    state = estimated(frame(k, SEEN) for k in range(5))
    stale = estimator.step(state, frame(5, (OtherBody("two", (3.01, 0.0, 1.0)), SEEN[1]), back_s=0.1), PARAMS)
    assert stale.verdict is Verdict.STALE
    assert (stale.others, stale.others_s) == (state.others, state.others_s)


@pytest.mark.parametrize("back_s", [0.5, -0.5])
def test_on_a_new_clock_one_that_moves_is_followed_and_a_parked_one_stays_parked(back_s: float) -> None:
    def seen(number: int) -> tuple[OtherBody, ...]:
        return OtherBody("two", (3.0 - DT_S * number, 0.0, 1.0)), OtherBody("three", (0.0, 3.0, 0.1))

    state = estimated(frame(k, seen(k), back_s=0.0 if k < 150 else back_s) for k in range(175))
    assert state.vehicle is not None
    two, three = state.vehicle.others
    assert two.position_w_m[0] == pytest.approx(3.0 - 1.74, abs=0.03)
    assert two.velocity_w_mps[0] == pytest.approx(-1.0, abs=0.1)
    assert three.parked


def test_without_others_nothing_is_different() -> None:
    alone, beside = (estimated(frame(k, seen) for k in range(20)) for seen in ((), SEEN))
    assert alone.vehicle is not None
    assert beside.vehicle is not None
    assert alone.vehicle.others == ()
    assert np.array_equal(alone.vehicle.position_w_m, beside.vehicle.position_w_m)
    assert np.array_equal(alone.vehicle.velocity_w_mps, beside.vehicle.velocity_w_mps)
    assert (alone.others, alone.others_s) == ((), -math.inf)


def test_a_record_gives_the_state_back_to_the_last_bit() -> None:
    state = estimated(frame(k, SEEN) for k in range(7))
    again = of_json(EstimatorState, to_json(state))
    assert to_json(again.others) == to_json(state.others)
    after, later = (estimator.step(one, frame(7, SEEN), PARAMS) for one in (again, state))
    assert to_json(after.others) == to_json(later.others)
