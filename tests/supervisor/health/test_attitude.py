"""Attitudes that disagree, and setpoints that are not followed."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import Array, AttitudeThrust
from companion.geometry.frames import quat_from_yaw, quat_multiply, up_axis
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.attitude import AttitudeHealth, ExpectedTilt, check_attitude
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from tests.supervisor.observing import (
    CYCLE_S,
    LEVEL,
    RULES,
    faults,
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

AT_ONCE = replace(RULES, apart_s=0.0)


def apart(cycle: int, q: Array) -> HealthInputs:
    """On the ground with turning rotors."""
    return standing(with_status(healthy(cycle), q_w_flu_wxyz=q))


@pytest.mark.parametrize(
    ("q", "fault", "what"),
    [
        (tilted(0.249), None, ""),
        (tilted(0.251), Fault.ATTITUDE_DISAGREES, "tilt by 0.25 rad"),
        (tilted(0.0, -0.249), None, ""),
        (tilted(0.0, -0.3), Fault.ATTITUDE_DISAGREES, "tilt by 0.30 rad"),
        (tilted(math.pi), Fault.ATTITUDE_DISAGREES, "tilt by 3.14 rad"),
        (tilted(0.0, 0.0, 0.374), None, ""),
        (tilted(0.0, 0.0, -0.376), Fault.HEADING_DISAGREES, "heading by 0.38 rad"),
        (tilted(0.0, 0.0, 3.0), Fault.HEADING_DISAGREES, "heading by 3.00 rad"),
    ],
)
def test_attitudes_may_differ_by_so_much(q: Array, fault: Fault | None, what: str) -> None:
    text = f"motion capture and autopilot disagree on the {what}"
    assert watched([apart(0, q)], AT_ONCE) == [() if fault is None else (Event(fault, text),)]


@pytest.mark.parametrize("lean", [tilted(0.5, 0.0), tilted(0.0, 0.5), tilted(0.4, 0.4), tilted(-0.4, 0.4)])
@pytest.mark.parametrize("turn_rad", [0.37, 0.38, -0.38])
def test_a_heading_is_a_turn_about_the_vertical_however_the_vehicle_leans(lean: Array, turn_rad: float) -> None:
    now = with_vehicle(apart(0, quat_multiply(quat_from_yaw(turn_rad), lean)), q_w_flu_wxyz=lean)
    found = watched([now], replace(AT_ONCE, tilt_apart_rad=1.0))[0]
    assert (Fault.HEADING_DISAGREES in faults(found)) == (abs(turn_rad) > 0.375)


def test_tilt_is_compared_in_the_world() -> None:
    """Two headings with the same tilt in the world, and the same tilt in two bodies that head apart."""
    same = with_vehicle(apart(0, tilted(0.2, 0.1)), q_w_flu_wxyz=tilted(0.2, 0.1))
    assert watched([same], AT_ONCE) == [()]
    mirrored = with_vehicle(apart(0, tilted(0.2)), q_w_flu_wxyz=tilted(-0.2))
    assert faults(watched([mirrored], AT_ONCE)[0]) == [Fault.ATTITUDE_DISAGREES]


def test_headings_are_compared_the_short_way_round() -> None:
    near = with_vehicle(apart(0, quat_from_yaw(-3.0)), q_w_flu_wxyz=quat_from_yaw(3.0))
    assert watched([near], AT_ONCE) == [()]
    far = with_vehicle(apart(0, quat_from_yaw(-2.9)), q_w_flu_wxyz=quat_from_yaw(2.9))
    text = "motion capture and autopilot disagree on the heading by 0.48 rad"
    assert watched([far], AT_ONCE) == [(Event(Fault.HEADING_DISAGREES, text),)]


@pytest.mark.parametrize("q", [tilted(0.5), tilted(0.0, 0.0, 0.5)])
def test_they_must_last(q: Array) -> None:
    for_long = watched([apart(k, q) for k in range(40)])
    assert [bool(events) for events in for_long] == [k >= 32 for k in range(40)]
    broken = watched([apart(k, LEVEL if k == 20 else q) for k in range(52)])
    assert not any(broken)


@pytest.mark.parametrize("q", [tilted(0.5), tilted(0.0, 0.0, 0.5)])
def test_they_are_compared_only_when_both_are_known(q: Array) -> None:
    now = apart(0, q)
    assert len(watched([now], AT_ONCE)[0]) == 1
    old = [event for event in watched([with_seen(now, age_s=0.125)], AT_ONCE)[0] if "disagree" in event.fault]
    assert not old
    assert watched([with_seen(now, age_s=0.1249)], AT_ONCE)[0][-1].fault.endswith("disagree")
    assert not watched([replace(now, commanded=False)], AT_ONCE)[0]
    assert not watched([with_seen(now, vehicle=None)], AT_ONCE)[0]


def test_what_the_autopilot_said_a_while_ago_is_compared_with_nothing() -> None:
    now = replace(apart(0, tilted(0.5)), time_s=0.2)
    assert check_attitude(AttitudeHealth(), with_status(now, attitude_s=0.0), AT_ONCE)[1]
    silent = with_status(now, attitude_s=-1e-9, heard_s=0.2, heartbeat_s=0.2)
    assert not check_attitude(AttitudeHealth(), silent, AT_ONCE)[1], "a heartbeat makes no attitude fresh"


def test_a_pause_ends_a_disagreement() -> None:
    flight = [apart(k, tilted(0.5)) for k in range(50)]
    flight[20] = replace(flight[20], commanded=False)
    assert not any(watched(flight[:52]))


def flown(setpoint: Callable[[float], Array], measured: Callable[[float], Array], seconds: float) -> list[HealthInputs]:
    flight = []
    for k in range(round(seconds / CYCLE_S)):
        t = k * CYCLE_S
        q = measured(t)
        now = with_vehicle(with_status(healthy(k), q_w_flu_wxyz=q), q_w_flu_wxyz=q)
        flight.append(replace(now, sent=AttitudeThrust(setpoint(t), np.array(0.5))))
    return flight


def answers(setpoint: Callable[[float], float], times_s: list[float], start: float = 0.0) -> list[ExpectedTilt]:
    """The model's own answer about x and y, at uneven times."""
    memory, found = AttitudeHealth(), []
    for k, time_s in enumerate(times_s):
        tilt = setpoint(time_s)
        now = with_vehicle(healthy(k), q_w_flu_wxyz=tilted(0.0, start))
        now = replace(now, time_s=time_s, sent=AttitudeThrust(tilted(-tilt, 0.5 * tilt), np.array(0.5)))
        memory, _ = check_attitude(memory, now, RULES)
        assert memory.answer is not None
        found.append(memory.answer)
    return found


def test_the_healthy_answer_is_of_second_order() -> None:
    """Against small steps of the differential equation, the setpoint stepping up and down."""
    times_s = np.cumsum([0.0, *[0.005, 0.02, 0.012, 0.05] * 20]).tolist()
    found = answers(lambda t: 0.4 if t < 0.5 else -0.3, times_s)
    h, w, damping = 1e-5, 7.0, 0.8
    x = v = t = 0.0
    for time_s, answer, before_s in zip(times_s[1:], found[1:], times_s, strict=False):
        wanted = math.sin(0.5 * (0.4 if before_s < 0.5 else -0.3)) * math.cos(0.4 if before_s < 0.5 else 0.3)
        for _ in range(round((time_s - t) / h)):
            v += h * (w * w * (wanted - x) - 2.0 * damping * w * v)
            x += h * v
        t = time_s
        assert answer.x == pytest.approx(x, abs=2e-4)
        assert answer.x_rate == pytest.approx(v, abs=2e-3)


def test_both_axes_answer_alike() -> None:
    times_s = [k * 0.01 for k in range(100)]
    for answer in answers(lambda t: 0.3 if t < 0.4 else -0.1, times_s)[:40]:
        ratio = math.sin(0.3) / (math.sin(0.15) * math.cos(0.3))
        assert answer.y == pytest.approx(ratio * answer.x, abs=1e-12)
        assert answer.y_rate == pytest.approx(ratio * answer.x_rate, abs=1e-12)


def test_it_begins_as_the_vehicle_is_and_at_rest() -> None:
    first, *_, last = answers(lambda _: 0.0, [5.0 + k * 0.01 for k in range(300)], start=0.25)
    assert first.x == pytest.approx(math.sin(0.25))
    assert (first.x_rate, first.y, first.y_rate) == (0.0, 0.0, 0.0)
    assert last.x == pytest.approx(0.0, abs=1e-6)


def test_a_long_pause_is_counted_as_a_second_and_time_never_goes_back() -> None:
    step = answers(lambda _: 0.3, [0.0, 1.0, 1.0, 0.0])
    pause = answers(lambda _: 0.3, [0.0, 60.0])
    assert step[1].x == pause[1].x > 0.0
    assert step[2].x == pytest.approx(step[1].x)
    assert step[3].x == pytest.approx(step[1].x)


def test_a_setpoint_that_is_not_followed() -> None:
    """Level although 0.4 rad are asked for from the second cycle on."""
    flight = flown(lambda t: tilted(0.0, 0.4) if t > 0.0 else LEVEL, lambda _: LEVEL, 1.5)
    events = watched(flight)
    times_s = [k * CYCLE_S for k, found in enumerate(events) if Fault.SETPOINT_NOT_FOLLOWED in faults(found)]
    wd = 7.0 * 0.6
    rise = [k * CYCLE_S for k in range(1, 192)]
    x = [math.sin(0.4) * (1 - math.exp(-5.6 * t) * (math.cos(wd * t) + 5.6 / wd * math.sin(wd * t))) for t in rise]
    crossed_s = next(t for t, tilt in zip(rise, x, strict=True) if math.asin(tilt) > 0.25) + CYCLE_S
    assert times_s[0] == crossed_s + 0.5
    assert len(times_s) == round(1.5 / CYCLE_S) - round(times_s[0] / CYCLE_S)
    assert events[-1] == (
        Event(Fault.SETPOINT_NOT_FOLLOWED, "the tilt is 0.40 rad off the answer of a healthy vehicle"),
    )


@pytest.mark.parametrize("wanted", [tilted(0.4), tilted(-0.4), tilted(0.0, -0.4), tilted(0.3, 0.3)])
def test_how_far_off_it_is_is_the_angle_about_any_axis(wanted: Array) -> None:
    events = watched(flown(lambda t: wanted if t > 0.0 else LEVEL, lambda _: LEVEL, 2.0))
    off_rad = math.acos(float(up_axis(wanted)[2]))
    assert text_of(events[-1], Fault.SETPOINT_NOT_FOLLOWED).startswith(f"the tilt is {off_rad:.2f} rad off")


def test_upside_down_is_not_following() -> None:
    events = watched(flown(lambda _: LEVEL, lambda t: tilted(0.0 if t < 0.1 else math.pi), 1.0))
    assert events[-1][-1].text == "the tilt is 3.14 rad off the answer of a healthy vehicle"


@pytest.mark.parametrize(("off_rad", "told"), [(0.249, False), (0.251, True)])
def test_so_much_may_be_off(off_rad: float, told: bool) -> None:
    flight = flown(lambda _: tilted(0.1), lambda t: tilted(0.1 + (off_rad if t > 0.0 else 0.0)), 1.0)
    assert bool(watched(flight)[-1]) is told


def test_what_is_not_followed_on_the_ground_or_with_an_old_pose_is_not_judged() -> None:
    flight = flown(lambda _: tilted(0.0, 0.4), lambda _: LEVEL, 1.0)
    assert watched(flight)[-1]
    assert not any(watched([standing(now) for now in flight]))
    old = watched([with_seen(now, age_s=0.125) for now in flight])
    assert not [1 for events in old if Fault.SETPOINT_NOT_FOLLOWED in faults(events)]
    assert Fault.SETPOINT_NOT_FOLLOWED in faults(watched([with_seen(now, age_s=0.1249) for now in flight])[-1])
    assert not any(watched([replace(now, sent=None) for now in flight]))


def turned(cycle: int, q: Array) -> HealthInputs:
    """Standing with turning rotors, as both see it."""
    return standing(with_vehicle(with_status(healthy(cycle), q_w_flu_wxyz=q), q_w_flu_wxyz=q))


@pytest.mark.parametrize(("off_rad", "told"), [(0.249, False), (0.251, True)])
@pytest.mark.parametrize("slope_rad", [0.0, 0.3])
def test_who_tips_over_on_the_ground_is_told_of(slope_rad: float, off_rad: float, told: bool) -> None:
    """Against how it stood at arming: the ground may slope."""
    flight = [turned(k, tilted(slope_rad)) for k in range(10)]
    flight += [turned(k, tilted(slope_rad - off_rad)) for k in range(10, 100)]
    events = watched(flight)
    assert [bool(found) for found in events] == [told and k >= 74 for k in range(100)]
    if told:
        text = "the tilt is 0.25 rad off what it was at arming: it tips over"
        assert events[-1] == (Event(Fault.SETPOINT_NOT_FOLLOWED, text),)


def test_how_it_stood_is_of_this_arming() -> None:
    flight = [turned(k, tilted(0.0)) for k in range(10)]
    carried = [on_ground(turned(k, tilted(0.5))) for k in range(10, 20)]
    again = [turned(k, tilted(0.5)) for k in range(20, 120)]
    assert not any(watched([*flight, *carried, *again]))
    assert watched([*flight, *again])[-1], "not disarmed in between"


def test_with_an_old_pose_nobody_tips_over() -> None:
    flight = [turned(0, LEVEL), *(with_seen(turned(k, tilted(0.5)), age_s=0.125) for k in range(1, 100))]
    assert Fault.SETPOINT_NOT_FOLLOWED not in {fault for found in watched(flight) for fault in faults(found)}


def test_the_angle_is_the_whole_one_about_any_axis() -> None:
    """Both tilted, about both axes, and not about the same: each part of the cross product counts with its sign."""
    for ours, theirs in itertools.product((tilted(0.3, 0.4), tilted(-0.5, 0.2), tilted(2.0, -0.7)), repeat=2):
        a, b = up_axis(ours), up_axis(theirs)
        angle_rad = math.acos(min(1.0, float(a @ b)))
        now = with_vehicle(apart(0, theirs), q_w_flu_wxyz=ours)
        found = [event for event in watched([now], AT_ONCE)[0] if event.fault is Fault.ATTITUDE_DISAGREES]
        assert [event.text[-9:] for event in found] == ([f" {angle_rad:.2f} rad"] if angle_rad > 0.25 else [])


def test_the_answer_begins_anew_in_the_next_flight() -> None:
    flight = flown(lambda _: tilted(0.0, 0.4), lambda _: LEVEL, 0.5)
    ground = standing(healthy(64))
    again = [replace(now, time_s=now.time_s + 0.6) for now in flight]
    memory = AttitudeHealth()
    for now in [*flight, ground]:
        memory, _ = check_attitude(memory, now, RULES)
    assert memory == AttitudeHealth(stood=(0.0, 0.0, 1.0))
    memory, _ = check_attitude(memory, again[0], RULES)
    assert memory.answer is not None
    assert (memory.answer.x, memory.answer.x_rate) == (0.0, 0.0)


def test_a_broken_answer_begins_anew() -> None:
    flight = flown(lambda t: np.full(4, math.nan) if t == 0.125 else LEVEL, lambda _: LEVEL, 1.0)
    assert not any(watched(flight))
    flight = flown(lambda t: np.full(4, math.nan) if t == 0.125 else tilted(0.0, 0.4), lambda _: LEVEL, 1.5)
    assert watched(flight)[-1]


@pytest.mark.parametrize("bandwidth_radps", [6.3, 12.0])
@pytest.mark.parametrize("damping", [0.7, 1.0])
@pytest.mark.parametrize("delay_s", [0.02, 0.08])
@pytest.mark.parametrize("period_s", [0.4, 0.8, 2.0])
def test_sound_vehicles_follow_the_wildest_setpoints(
    bandwidth_radps: float, damping: float, delay_s: float, period_s: float
) -> None:
    """Command full tilt and then full tilt the other way, with the real limits."""
    wanted = [0.52 if k * 0.01 % period_s < 0.5 * period_s else -0.52 for k in range(300)]
    x = v = 0.0
    memory, events = AttitudeHealth(), []
    for k in range(300):
        q = tilted(0.0, x)
        now = with_vehicle(with_status(healthy(k), q_w_flu_wxyz=q), q_w_flu_wxyz=q)
        now = replace(now, time_s=k * 0.01, sent=AttitudeThrust(tilted(0.0, wanted[k]), np.array(0.5)))
        memory, found = check_attitude(memory, now, SafetyRules())
        events += found
        for _ in range(10):
            heard = wanted[max(0, k - round(delay_s / 0.01))]
            v += 0.001 * (bandwidth_radps**2 * (heard - x) - 2.0 * damping * bandwidth_radps * v)
            x += 0.001 * v
    assert not events
