"""Age, frozen and jumped: at their limits, and by what the newest frames are."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.state import Verdict
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health_inputs import HealthInputs
from tests.supervisor.observing import (
    CYCLE_S,
    faults,
    handed_over,
    healthy,
    on_ground,
    standing,
    text_of,
    tilted,
    watched,
    with_seen,
    with_status,
    with_vehicle,
)


def aged(age_s: float, verdict: Verdict | None = Verdict.OUTLIER, quiet_s: float = 0.0) -> HealthInputs:
    now = healthy(0)
    return with_seen(now, age_s=age_s, verdict=verdict, received_s=now.time_s - quiet_s)


@pytest.mark.parametrize(
    ("age_s", "fault", "text"),
    [
        (0.0625, None, ""),
        (0.0626, Fault.MOCAP_LATE, "the newest usable pose is 0.063 s old"),
        (0.1250, Fault.MOCAP_LATE, "the newest usable pose is 0.125 s old"),
        (0.1251, Fault.MOCAP_DEGRADED, "the newest usable pose is 0.125 s old"),
        (0.2500, Fault.MOCAP_DEGRADED, "the newest usable pose is 0.250 s old"),
        (
            *(0.2501, Fault.MOCAP_OUTLIERS),
            "no usable pose for 0.25 s: frames are further off than the vehicle can have moved",
        ),
        (
            3.0,
            Fault.MOCAP_OUTLIERS,
            "no usable pose for 3.00 s: frames are further off than the vehicle can have moved",
        ),
        (math.inf, Fault.MOCAP_OUTLIERS, "no usable pose yet: frames are further off than the vehicle can have moved"),
        (math.nan, Fault.MOCAP_OUTLIERS, "no usable pose yet: frames are further off than the vehicle can have moved"),
    ],
)
def test_age_has_one_event(age_s: float, fault: Fault | None, text: str) -> None:
    assert watched([aged(age_s)]) == [() if fault is None else (Event(fault, text),)]


def test_before_anything_is_sent_the_age_is_the_preflights_matter() -> None:
    assert watched([on_ground(aged(9.0))]) == [()]
    assert faults(watched([with_status(on_ground(aged(9.0)), armed=True)])[0]) == [Fault.MOCAP_OUTLIERS]
    idle = with_status(aged(9.0), armed=False)
    assert Fault.MOCAP_OUTLIERS in faults(watched([idle])[0]), "setpoints leave, before it is armed"


@pytest.mark.parametrize(
    ("verdict", "fault", "why"),
    [
        (Verdict.UNTRACKED, Fault.MOCAP_NAN, "frames arrive without the body"),
        (Verdict.INVALID, Fault.MOCAP_INVALID, "frames are no rotation or outside of any room"),
        (Verdict.OUTLIER, Fault.MOCAP_OUTLIERS, "frames are further off than the vehicle can have moved"),
        (Verdict.REPEATED, Fault.MOCAP_FROZEN, "frames repeat one pose to the last bit"),
        (Verdict.STALE, Fault.MOCAP_SILENT, "frames are older than one already used"),
        (Verdict.AHEAD, Fault.MOCAP_CLOCK_JUMP, "frames were captured later than they came, by their stamps"),
        (Verdict.ACCEPTED, Fault.MOCAP_SILENT, "frames arrive too late"),
        (None, Fault.MOCAP_SILENT, "no frames arrive"),
    ],
)
def test_silence_is_named_by_the_newest_frame(verdict: Verdict | None, fault: Fault, why: str) -> None:
    assert watched([aged(0.5, verdict)]) == [(Event(fault, f"no usable pose for 0.50 s: {why}"),)]


@pytest.mark.parametrize(
    ("age_s", "quiet_s", "fault"),
    [
        (0.375, 0.1875, Fault.MOCAP_NAN),
        (0.375, 0.1895, Fault.MOCAP_SILENT),
        (8.0, 0.25, Fault.MOCAP_NAN),
        (8.0, 0.252, Fault.MOCAP_SILENT),
        (math.inf, 0.25, Fault.MOCAP_NAN),
        (math.inf, 0.252, Fault.MOCAP_SILENT),
        (math.inf, math.nan, Fault.MOCAP_SILENT),
    ],
)
def test_no_frame_for_half_of_the_age_is_silence(age_s: float, quiet_s: float, fault: Fault) -> None:
    (events,) = watched([aged(age_s, Verdict.UNTRACKED, quiet_s)])
    assert faults(events) == [fault]
    if fault is Fault.MOCAP_SILENT:
        assert events[0].text.endswith(": no frames arrive")


def repeating(cycle: int, age_s: float = 0.0) -> HealthInputs:
    return with_seen(healthy(cycle), verdict=Verdict.REPEATED, age_s=age_s)


def test_frozen_after_its_time_while_frames_arrive() -> None:
    events = watched([healthy(0), *(repeating(k) for k in range(1, 19))])
    assert not any(events[:17])
    assert events[17:] == [
        (Event(Fault.MOCAP_FROZEN, "the pose is the same to the last bit for 0.12 s"),),
        (Event(Fault.MOCAP_FROZEN, "the pose is the same to the last bit for 0.13 s"),),
    ]


def test_one_pose_in_between_is_not_frozen() -> None:
    assert not any(watched([healthy(k) if k == 16 else repeating(k) for k in range(32)]))
    other = [with_seen(healthy(k), verdict=Verdict.OUTLIER) if k == 16 else repeating(k) for k in range(32)]
    assert not any(watched(other))


def test_one_repeated_frame_and_then_none_is_not_frozen() -> None:
    first = repeating(1)
    later = [replace(first, time_s=first.time_s + k * CYCLE_S) for k in range(20)]
    assert not any(watched([healthy(0), *later]))


def test_frozen_beside_the_age_and_then_alone() -> None:
    events = watched([healthy(0), *(repeating(k, k * CYCLE_S) for k in range(1, 40))])
    assert faults(events[9]) == [Fault.MOCAP_LATE]
    assert faults(events[17]) == [Fault.MOCAP_DEGRADED, Fault.MOCAP_FROZEN]
    assert faults(events[32]) == [Fault.MOCAP_DEGRADED, Fault.MOCAP_FROZEN]
    assert events[33] == (
        Event(Fault.MOCAP_FROZEN, "no usable pose for 0.26 s: frames repeat one pose to the last bit"),
    )


def test_frozen_on_the_ground_before_anything_is_sent() -> None:
    events = watched([*(on_ground(repeating(k)) for k in range(40)), repeating(40)])
    assert not any(events[:40])
    assert faults(events[40]) == [Fault.MOCAP_FROZEN]


def started(cycle: int) -> HealthInputs:
    now = healthy(cycle, (1.5, -0.25, 1.0))
    return with_vehicle(with_seen(now, verdict=Verdict.STARTED), q_w_flu_wxyz=tilted(0.0, 0.0, 0.25))


def test_a_jump_in_the_air_stays_until_the_ground() -> None:
    flight = [healthy(0), started(1), healthy(2), standing(healthy(3)), healthy(4)]
    events = watched(flight)
    assert [Fault.MOCAP_JUMPED in faults(found) for found in events] == [False, True, True, False, False]
    for found in events[1:3]:
        text = "the pose jumped by 1.00 m and 0.25 rad, or came back so after a gap"
        assert text_of(found, Fault.MOCAP_JUMPED) == text


def test_a_jump_is_over_on_the_ground_without_a_frame_too() -> None:
    jumped = started(1)
    down = replace(standing(jumped), time_s=jumped.time_s + CYCLE_S)
    up = replace(jumped, time_s=jumped.time_s + 2 * CYCLE_S)
    events = watched([healthy(0), jumped, down, up])
    assert [Fault.MOCAP_JUMPED in faults(found) for found in events] == [False, True, False, False]


def test_what_was_seen_on_the_ground_is_known_in_a_cycle_without_a_frame_too() -> None:
    ground = standing(healthy(0))
    waiting = replace(ground, time_s=ground.time_s + CYCLE_S)
    text = text_of(watched([ground, waiting, started(2)])[-1], Fault.MOCAP_JUMPED)
    assert text.startswith("the pose jumped by 1.00 m")
    still: list[HealthInputs] = []
    for k in range(1, 19):
        still += [standing(repeating(k)), replace(standing(repeating(k)), time_s=healthy(k).time_s + CYCLE_S / 2.0)]
    assert faults(watched([standing(healthy(0)), *still])[-1]) == [Fault.MOCAP_FROZEN]


def test_a_start_on_the_ground_is_no_jump() -> None:
    begun = standing(started(0))
    assert not any(watched([begun, replace(started(0), time_s=begun.time_s + CYCLE_S)]))


def test_who_lands_or_is_flown_by_another_is_given_poses_that_are_looked_at() -> None:
    """Bodies swapped after a hand-over: the autopilot would follow."""
    theirs = [handed_over(healthy(0)), handed_over(started(1)), handed_over(healthy(2))]
    assert [faults(found) for found in watched(theirs)] == [[], [Fault.MOCAP_JUMPED], [Fault.MOCAP_JUMPED]]
    assert not any(watched([with_status(now, armed=False) for now in theirs])), "carried by hand"
    assert not any(watched([with_status(now, in_air=False) for now in theirs])), "carried by hand, armed"
    unknown = watched([with_status(now, in_air=None) for now in theirs])
    assert faults(unknown[-1]) == [Fault.MOCAP_JUMPED], "whoever may fly is not taken for one that stands"
    frozen = [handed_over(repeating(k)) for k in range(1, 19)]
    assert faults(watched([handed_over(healthy(0)), *frozen])[-1]) == [Fault.MOCAP_FROZEN]


def test_a_jump_that_ended_our_flight_is_still_one_afterwards() -> None:
    events = watched([healthy(0), started(1), handed_over(healthy(2)), handed_over(with_seen(healthy(2), age_s=0.0))])
    assert [Fault.MOCAP_JUMPED in faults(found) for found in events] == [False, True, True, True]


def test_the_first_frame_of_all_in_the_air_is_a_jump() -> None:
    assert text_of(watched([started(0)])[0], Fault.MOCAP_JUMPED) == "motion capture began anew in the air"
    nowhere = with_seen(started(1), vehicle=None)
    assert text_of(watched([healthy(0), nowhere])[1], Fault.MOCAP_JUMPED) == "motion capture began anew in the air"


def test_outliers_before_a_jump_do_not_move_what_it_is_measured_from() -> None:
    outliers = [with_seen(healthy(k), verdict=Verdict.OUTLIER) for k in range(1, 5)]
    text = text_of(watched([healthy(0), *outliers, started(5)])[5], Fault.MOCAP_JUMPED)
    assert text.startswith("the pose jumped by 1.00 m")


def test_a_jump_with_no_number_in_it_is_still_one() -> None:
    lost = with_vehicle(started(1), position_w_m=np.full(3, math.nan))
    assert Fault.MOCAP_JUMPED in faults(watched([healthy(0), lost])[1])
