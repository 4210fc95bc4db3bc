"""Tests of the hand test: a correct vehicle passes, and every classic mistake is distinguished."""

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from companion.core.types import Array
from companion.geometry.frames import matrix_from_quat, quat_from_matrix, quat_from_yaw
from companion.preflight.checks.hand_test import (
    Displacement,
    HandTest,
    Move,
    Track,
    at_rest,
    check_hand_test,
    is_over,
    judge,
    judge_together,
    moved,
    settled,
)

FAR_M = {Move.LIFT: 0.3, Move.FORWARD: 0.5, Move.LEFT: 0.5}
RATE_HZ = 50.0
Change = Callable[[Array], Array]


def turn(yaw_deg: float) -> Array:
    return matrix_from_quat(quat_from_yaw(math.radians(yaw_deg)))


def same(position: Array) -> Array:
    return position


def by(matrix: Array | list[list[float]]) -> Change:
    return lambda position: np.asarray(position @ np.array(matrix).T)


def carried(
    move: Move,
    *,
    heading_deg: float = 0.0,
    mocap: Change = same,
    body_deg: float = 0.0,
    autopilot: Change = same,
    autopilot_heading_deg: float = 0.0,
    lag_s: float = 0.2,
) -> Track:
    """Return the track of a true move, seen through the given mistakes.

    `mocap` and `autopilot` map the truth (n, 3) and motion capture's positions to what is shown; `body_deg` turns the
    body's axes in QTM, `autopilot_heading_deg` the autopilot's attitude.
    """
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 4.0, 1.0 / RATE_HZ)
    nose, left, up = turn(heading_deg)[:, 0], turn(heading_deg)[:, 1], np.array([0.0, 0.0, 1.0])
    way = {Move.LIFT: up, Move.FORWARD: nose, Move.LEFT: left}[move] * FAR_M[move]
    start = np.array([0.7, -0.4, 0.2])

    def place(at_s: Array) -> Array:
        share = np.clip((at_s - 1.0) / 1.5, 0.0, 1.0)[:, None]
        return start + way * (share * share * (3.0 - 2.0 * share))

    shown = mocap(place(time_s)) + rng.normal(0.0, 0.001, (len(time_s), 3))
    believed = autopilot(mocap(place(time_s - lag_s))) + rng.normal(0.0, 0.005, (len(time_s), 3))
    ours, theirs = (
        quat_from_matrix(turn(heading_deg + body_deg)),
        quat_from_yaw(math.radians(heading_deg + body_deg + autopilot_heading_deg)),
    )
    many = np.ones((len(time_s), 1))
    return Track(time_s, shown, many * ours, believed, many * theirs)


def all_moves(**mistakes: object) -> dict[Move, Displacement]:
    return {move: moved(carried(move, **mistakes)) for move in Move}  # type: ignore[arg-type]


@pytest.mark.parametrize("heading_deg", [0.0, 37.0, 90.0, -135.0, 180.0])
@pytest.mark.parametrize("move", list(Move))
def test_a_right_vehicle_passes_whatever_its_heading(move: Move, heading_deg: float) -> None:
    check = judge(move, moved(carried(move, heading_deg=heading_deg)))
    assert check.passed, check
    assert check.todo == ""
    assert judge_together(all_moves(heading_deg=heading_deg)).passed


@pytest.mark.parametrize(
    ("mocap", "shown"),
    [
        (by([[1, 0, 0], [0, -1, 0], [0, 0, -1]]), "-z"),
        (by([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), "-y"),
        (by([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), "+y"),
        (by([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), "+x"),
    ],
)
def test_a_room_whose_up_is_not_z_is_told_by_the_lift(mocap: Change, shown: str) -> None:
    check = judge(Move.LIFT, moved(carried(Move.LIFT, mocap=mocap)))
    assert not check.passed
    assert f"shows the lift along its {shown}, not its +z" in check.todo


@pytest.mark.parametrize(
    ("body_deg", "forward", "left"),
    [(90.0, "right", "nose"), (-90.0, "left", "tail"), (180.0, "tail", "right")],
)
@pytest.mark.parametrize("heading_deg", [0.0, 60.0])
def test_a_body_whose_x_is_not_the_nose_is_told_by_the_push(
    body_deg: float, forward: str, left: str, heading_deg: float
) -> None:
    for move, way in ((Move.FORWARD, forward), (Move.LEFT, left)):
        check = judge(move, moved(carried(move, body_deg=body_deg, heading_deg=heading_deg)))
        assert not check.passed
        assert f"it goes towards the {way} of the body in QTM" in check.todo
    assert judge(Move.LIFT, moved(carried(Move.LIFT, body_deg=body_deg))).passed


@pytest.mark.parametrize(
    ("turned_deg", "sentence"),
    [
        (90.0, "motion capture's +x is the autopilot's +y, 90 degrees to the left"),
        (-90.0, "motion capture's +x is the autopilot's -y, 90 degrees to the right"),
        (180.0, "motion capture's +x is the autopilot's -x, 180 degrees"),
        (35.0, "35 degrees to the left"),
        (-20.0, "20 degrees to the right"),
    ],
)
def test_an_autopilot_whose_frame_is_turned_is_told_by_how_much(turned_deg: float, sentence: str) -> None:
    check = judge(Move.FORWARD, moved(carried(Move.FORWARD, autopilot=by(turn(turned_deg)))))
    assert not check.passed
    assert sentence in check.todo


@pytest.mark.parametrize(
    ("autopilot", "axes"),
    [
        (turn(90.0), "autopilot's x is mocap's -y, autopilot's y is mocap's +x, autopilot's z is mocap's +z"),
        (turn(-90.0), "autopilot's x is mocap's +y, autopilot's y is mocap's -x, autopilot's z is mocap's +z"),
        (turn(180.0), "autopilot's x is mocap's -x, autopilot's y is mocap's -y, autopilot's z is mocap's +z"),
    ],
)
@pytest.mark.parametrize("heading_deg", [0.0, 30.0])
def test_together_the_moves_name_a_turned_frame(autopilot: Array, axes: str, heading_deg: float) -> None:
    check = judge_together(all_moves(autopilot=by(autopilot), heading_deg=heading_deg))
    assert not check.passed
    assert check.says == axes
    assert "turned" in check.todo


@pytest.mark.parametrize(
    ("mirror", "axes"),
    [
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "autopilot's x is mocap's -x, autopilot's y is mocap's +y"),
        ([[1, 0, 0], [0, -1, 0], [0, 0, 1]], "autopilot's x is mocap's +x, autopilot's y is mocap's -y"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "autopilot's x is mocap's +y, autopilot's y is mocap's +x"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], "autopilot's z is mocap's -z"),
    ],
)
def test_together_the_moves_tell_a_mirrored_frame_from_a_turned_one(mirror: list[list[float]], axes: str) -> None:
    check = judge_together(all_moves(autopilot=by(mirror)))
    assert not check.passed
    assert axes in check.says
    assert "mirrored" in check.todo


def test_a_mirror_that_one_push_cannot_see_is_seen_by_the_other() -> None:
    mirrored = by([[1, 0, 0], [0, -1, 0], [0, 0, 1]])
    assert judge(Move.FORWARD, moved(carried(Move.FORWARD, autopilot=mirrored))).passed
    check = judge(Move.LEFT, moved(carried(Move.LEFT, autopilot=mirrored)))
    assert not check.passed
    assert "motion capture's +y is the autopilot's -y" in check.todo


@pytest.mark.parametrize("mirror", [np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0]), np.diag([1.0, 1.0, -1.0])])
def test_a_mirrored_room_is_told(mirror: Array) -> None:
    check = judge_together(all_moves(mocap=by(mirror)))
    assert not check.passed
    assert "motion capture is mirrored" in check.todo


@pytest.mark.parametrize(("scale", "words"), [(2.0, "2.0"), (0.5, "0.5"), (1.4, "1.4")])
def test_an_autopilot_with_another_yardstick_is_told(scale: float, words: str) -> None:
    check = judge(Move.LIFT, moved(carried(Move.LIFT, autopilot=lambda position: scale * position)))
    assert not check.passed
    assert f"{words}" in check.todo
    assert "times motion capture's distance" in check.todo


@pytest.mark.parametrize("share", [0.0, 0.2, math.nan])
def test_an_autopilot_that_does_not_follow_does_not_fuse(share: float) -> None:
    for move in Move:
        check = judge(move, moved(carried(move, autopilot=lambda position: share * position)))
        assert not check.passed
        assert "does not fuse vision" in check.todo


@pytest.mark.parametrize("off_deg", [90.0, -90.0, 180.0, 30.0, -30.0])
def test_a_position_that_is_right_under_a_heading_that_is_not_is_the_toilet_bowl(off_deg: float) -> None:
    check = judge(Move.FORWARD, moved(carried(Move.FORWARD, autopilot_heading_deg=off_deg)))
    assert not check.passed
    assert "the autopilot's heading is off by" in check.todo
    if abs(off_deg) < 180.0:
        said = float(check.todo.split("off by ")[1].split(" degrees")[0])
        assert said == pytest.approx(off_deg, abs=3.0)


def test_a_hand_that_is_not_exact_is_forgiven() -> None:
    askew = by(turn(20.0))
    track = carried(Move.FORWARD, mocap=askew)  # pushed 20 degrees beside its nose
    assert judge(Move.FORWARD, moved(track)).passed


def test_moves_along_one_line_cannot_tell() -> None:
    one = moved(carried(Move.FORWARD))
    check = judge_together(dict.fromkeys(Move, one))
    assert not check.passed
    assert "not across each other" in check.says


def cut(track: Track, end_s: float) -> Track:
    keep = track.time_s <= end_s
    return Track(
        track.time_s[keep],
        track.mocap_w_m[keep],
        track.mocap_q_wxyz[keep],
        track.autopilot_w_m[keep],
        track.autopilot_q_wxyz[keep],
    )


def test_a_move_is_over_when_it_went_far_enough_and_rests() -> None:
    track = carried(Move.FORWARD)
    assert at_rest(cut(track, 0.9))
    assert not is_over(cut(track, 0.9), Move.FORWARD), "it has not moved yet"
    assert not is_over(cut(track, 2.0), Move.FORWARD), "it moves"
    assert not is_over(cut(track, 2.6), Move.FORWARD), "it has just stopped"
    assert is_over(cut(track, 3.5), Move.FORWARD)
    late = carried(Move.FORWARD, lag_s=1.0)
    assert is_over(cut(late, 3.5), Move.FORWARD)
    assert not settled(cut(late, 3.5)), "the autopilot still follows"
    assert settled(carried(Move.FORWARD, lag_s=0.5))
    assert is_over(carried(Move.FORWARD, mocap=by(np.diag([-1.0, -1.0, 1.0]))), Move.FORWARD), "whatever the way"
    short = replace(track, mocap_w_m=track.mocap_w_m[:1] + 0.4 * (track.mocap_w_m - track.mocap_w_m[:1]))
    assert not is_over(short, Move.FORWARD), "0.2 m is too little"


NOW = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)


def test_a_carry_counts_for_its_body_and_for_a_while() -> None:
    kept = HandTest("dauam", NOW - timedelta(hours=3))
    assert check_hand_test(kept, "dauam", NOW, 24.0).passed
    assert not check_hand_test(kept, "dauam", NOW, 2.0).passed
    stale = check_hand_test(
        HandTest("dauam", NOW - timedelta(hours=30), "/var/lib/dauam/by_hand.json"), "dauam", NOW, 24.0
    )
    assert stale.says == "'dauam' 30.0 h ago, 'dauam' within 24 h wanted (in /var/lib/dauam/by_hand.json)"
    assert not check_hand_test(kept, "drone", NOW, 24.0).passed
    assert not check_hand_test(HandTest("dauam", NOW + timedelta(hours=1)), "dauam", NOW, 24.0).passed, (
        "a clock that is wrong"
    )
    never = check_hand_test("never: there is no /var/lib/dauam/by_hand.json", "dauam", NOW, 24.0)
    assert (never.refuses, never.says) == (True, "never: there is no /var/lib/dauam/by_hand.json")
    assert check_hand_test("never", "dauam", NOW, 0.0).passed, "nobody asks for it"


def test_moves_that_are_right_end_without_a_remedy() -> None:
    seen = {move: moved(carried(move)) for move in Move}
    for check in (*(judge(move, seen[move]) for move in Move), judge_together(seen)):
        assert (check.passed, check.todo) == (True, "")
