"""Failures around the law and the loop in simulated time: the vehicle still comes down, and is seen to.

The faults of the table are flown in faults/; here it is the loop's own reaction that must not fail.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any, Never

import numpy as np
import pytest

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import PidGains
from companion.control.pid import Pid, PidMemory
from companion.core.interfaces import AutopilotError, MocapError
from companion.core.types import Array, AttitudeThrust, FlightMode, MocapFrame
from companion.geometry.frames import up_axis
from companion.supervisor.flight_state import (
    Action,
    FlightRules,
    HandOverRequest,
    KillRequest,
    LandRequest,
    Phase,
    ResumeRequest,
    TrackRequest,
)
from mock_autopilot.px4.vocabulary import Mode
from tests.flights.faults import acts
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import DOWN, LAP, QUICK_UP, ask, inject, until, wait

pytestmark = pytest.mark.slow


def do(act: Callable[[Flight], object]) -> Step:
    def step(flight: Flight) -> bool:
        act(flight)
        return True

    return step


def fail(_: object, *__: object) -> Never:
    raise RuntimeError("a mistake in the service itself")


async def flown_to_its_failure(script: list[Step], error: type[Exception], **conditions: Any) -> Flight:
    """Until the loop has raised it."""
    seen: list[Flight] = []
    with pytest.raises(error):
        await fly([do(seen.append), *script, wait(60.0)], **conditions)
    return seen[0]


def poses_of(flight: Flight) -> list[tuple[float, Array]]:
    """Return a list that fills with the times and places the autopilot is told from now on, s and m, W."""
    told: list[tuple[float, Array]] = []
    send = flight.autopilot.send_vision

    def tell(position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        told.append((flight.room.now_s(), position_w_m))
        send(position_w_m, q_w_flu_wxyz)

    flight.autopilot.send_vision = tell  # type: ignore[method-assign]
    return told


def answered_by(flight: Flight, action: Action, how: Callable[[], Awaitable[None]]) -> None:
    """Let the autopilot do something else when it is asked for this."""
    flight.loop._calls._how[action] = how


# --- the loop itself fails ---


async def test_when_the_loop_fails_the_autopilot_lands_and_sees_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[list[tuple[float, Array]]] = []

    def fail_at_once(flight: Flight) -> None:
        told.append(poses_of(flight))
        monkeypatch.setattr(flight.loop._health, "look", fail)

    script = [*QUICK_UP[:-1], lambda flight: bool(flight.room.truth_w_m[2] > 0.4), do(fail_at_once)]
    flight = await flown_to_its_failure(script, RuntimeError)
    assert flight.loop.flight.reason == "RuntimeError: a mistake in the service itself"
    assert flight.autopilot.land_calls == 1
    assert flight.phase is Phase.DISARMED
    assert flight.room.truth_w_m[2] < 0.05
    assert len(told[0]) > 30, "to the ground"
    assert np.linalg.norm(flight.room.truth_w_m[:2]) < 0.2


async def test_a_failed_loop_takes_a_kill_and_nothing_else() -> None:
    flight = await flown_to_its_failure(QUICK_UP, MocapError, mocap_lost_at_s=9.0)
    assert flight.room.bench.setpoint is None, "nobody repeats the last setpoint"
    for wanted in (ResumeRequest(), LandRequest(), HandOverRequest("")):
        assert "the flight loop has failed" in flight.loop.refusal(wanted)
        assert flight.loop.submit(wanted)
    assert flight.room.bench.setpoint is None
    assert not flight.loop.submit(KillRequest())
    while flight.loop._calls.pending:
        await asyncio.sleep(0)
        flight.room.bench.run(0.02)
    assert not flight.room.bench.world.vehicle.armed


async def test_closing_while_the_vehicle_is_taken_back_lands_it() -> None:
    closed: list[asyncio.Task[None]] = []

    def answer_late(flight: Flight) -> None:
        """OFFBOARD shows before its answer comes."""

        async def start_offboard() -> None:
            flight.autopilot.command(176, 1.0, 6.0, 0.0)
            while flight.phase is Phase.RESUME:  # noqa: ASYNC110 - simulated time, no event tells of it
                await asyncio.sleep(0)

        answered_by(flight, Action.OFFBOARD, start_offboard)

    def resume_and_close(flight: Flight) -> None:
        assert not flight.loop.submit(ResumeRequest())
        closed.append(asyncio.create_task(flight.loop.close()))

    pilot = [inject("autopilot wrong (pilot takes over)"), until(Phase.HANDED_OVER), wait(1.0)]
    flight = await fly([*QUICK_UP, do(answer_late), *pilot, do(resume_and_close), lambda _: closed[0].done()])
    await closed[0]
    assert flight.autopilot.land_calls == 1
    assert flight.phase is Phase.HANDED_OVER
    flight.room.bench.run(0.02)  # PX4 answers first, and flies the mode with its next pass
    assert flight.room.bench.world.vehicle.mode is Mode.LAND


# --- what cannot be sent ---


def setpoints_fail(times: float) -> Step:
    """So many from now on cannot be sent."""

    def arrange(flight: Flight) -> None:
        send, left = flight.autopilot.send_setpoint, [times]

        def try_to_send(setpoint: AttitudeThrust) -> None:
            left[0] -= 1
            if left[0] >= 0:
                raise AutopilotError("setpoint not sent: CONNECTION_ERROR")
            send(setpoint)

        flight.autopilot.send_setpoint = try_to_send  # type: ignore[method-assign]

    return do(arrange)


async def test_a_setpoint_that_cannot_be_sent_is_sent_a_cycle_later() -> None:
    flight = await fly(
        [*QUICK_UP, setpoints_fail(3), ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK), wait(1.0), *DOWN]
    )
    assert flight.phase is Phase.DISARMED
    assert flight.loop.flight.reason == ""


async def test_when_no_setpoint_can_be_sent_any_more_the_autopilot_lands() -> None:
    moving = [ask(TrackRequest(LAP, 0.5)), until(Phase.TRACK), wait(2.0)]
    flight = await fly([*QUICK_UP, *moving, setpoints_fail(np.inf), until(Phase.HANDED_OVER), until(Phase.DISARMED)])
    assert "no setpoint could be sent for 0.4" in flight.loop.flight.reason
    assert "CONNECTION_ERROR" in flight.loop.flight.reason
    assert flight.autopilot.land_calls == 1


async def test_the_command_to_land_does_not_hang_on_the_setpoint_before_it() -> None:
    flight = await fly(
        [*QUICK_UP, wait(1.0), setpoints_fail(np.inf), ask(HandOverRequest("somebody asked")), wait(1.0)]
    )
    assert flight.autopilot.land_calls == 1
    assert flight.autopilot.status().mode is FlightMode.LAND


async def test_a_pose_that_cannot_be_sent_ends_nothing() -> None:
    def break_the_link(flight: Flight) -> None:
        send, end_s = flight.autopilot.send_vision, flight.room.now_s() + 0.1

        def try_to_send(position_w_m: Array, q_w_flu_wxyz: Array) -> None:
            if flight.room.now_s() < end_s:
                raise AutopilotError("vision pose not sent: CONNECTION_ERROR")
            send(position_w_m, q_w_flu_wxyz)

        flight.autopilot.send_vision = try_to_send  # type: ignore[method-assign]

    flight = await fly([*QUICK_UP, do(break_the_link), wait(1.0), *DOWN])
    assert flight.phase is Phase.DISARMED
    assert flight.loop.flight.reason == ""


# --- the law's second half ---


class _TwoHalves(Pid):
    """A law whose second half fails once it is well in the air."""

    def decide(self, memory: PidMemory, now: ControlInput) -> tuple[tuple[PidMemory, float], ControlOutput]:
        after, output = self.step(memory, now)
        return (after, float(now.position_w_m[2])), output

    def settle(self, decided: tuple[PidMemory, float]) -> tuple[PidMemory, dict[str, Array]]:
        if decided[1] > 0.8:
            raise ZeroDivisionError("a mistake in the second half")
        return decided[0], {}


async def test_a_law_whose_second_half_raises_makes_the_autopilot_land_with_its_vision() -> None:
    law = _TwoHalves(PidGains())
    flight = await fly([*QUICK_UP[:-1], until(Phase.HANDED_OVER), until(Phase.DISARMED)], controller=law)
    assert flight.loop.flight.reason == "the control law failed: ZeroDivisionError: a mistake in the second half"
    assert flight.autopilot.land_calls == 1
    assert np.linalg.norm(flight.truths_w_m[-1][:2]) < 0.3


# --- streams that begin anew ---


async def test_taking_the_vehicle_back_ends_the_stream_that_was_left() -> None:
    said: list[str | AttitudeThrust] = []

    def listen(flight: Flight) -> None:
        stop, send = flight.autopilot.stop_stream, flight.autopilot.send_setpoint

        def stopping() -> None:
            said.append("stopped")
            stop()

        def sending(setpoint: AttitudeThrust) -> None:
            said.append(setpoint)
            send(setpoint)

        flight.autopilot.stop_stream, flight.autopilot.send_setpoint = stopping, sending  # type: ignore[method-assign]

    def take_back(flight: Flight) -> None:
        assert flight.room.bench.setpoint is not None, "level, until the autopilot lands"
        listen(flight)
        assert not flight.loop.submit(ResumeRequest())

    script = [
        *QUICK_UP,
        ask(HandOverRequest("somebody asked")),
        wait(0.1),
        do(take_back),
        until(Phase.HOLD),
        wait(2.0),
    ]
    flight = await fly(script, lost_land_commands=1)
    assert flight.phase is Phase.HOLD
    assert said[0] == "stopped"
    assert "stopped" not in said[1:-1], "and then when the flight is ended"
    first = said[1]
    assert isinstance(first, AttitudeThrust), "a setpoint is there before OFFBOARD is asked for"
    assert up_axis(first.q_w_flu_wxyz)[2] == pytest.approx(1.0, abs=1e-9), "idle: level, at hover thrust"
    assert first.thrust == pytest.approx(FlightRules().hover_thrust)


async def test_letting_go_of_a_silent_autopilot_leaves_it_level() -> None:
    push = do(acts.gust((12.0, 0.0, 0.0), 3.0))
    silent = [inject("link off (from the autopilot)"), until(Phase.HANDED_OVER), wait(0.5)]
    flight = await fly([*QUICK_UP, push, wait(0.5), *silent])
    before, last = [setpoint for _, setpoint in flight.autopilot.setpoints[-2:]]
    assert up_axis(before.q_w_flu_wxyz)[2] < 0.999, "it leaned against the push"
    assert up_axis(last.q_w_flu_wxyz)[2] == pytest.approx(1.0, abs=1e-9)
    assert flight.autopilot.setpoints[-1][0] <= flight.loop.flight.since_s
    assert flight.room.bench.setpoint is None, "and no stream"


async def test_a_pilot_gets_no_last_setpoint() -> None:
    flight = await fly([*QUICK_UP, wait(1.0), inject("autopilot wrong (pilot takes over)"), until(Phase.HANDED_OVER)])
    assert flight.autopilot.setpoints[-1][0] < flight.loop.flight.since_s


# --- what the autopilot is told of its place ---


async def test_poses_that_lost_trust_are_withheld_until_the_vehicle_is_disarmed() -> None:
    told: list[list[tuple[float, Array]]] = []
    listen = do(lambda flight: told.append(poses_of(flight)))
    jump = [inject("mocap wrong (jump) for 1 s"), until(Phase.HANDED_OVER), listen]
    flight = await fly([*QUICK_UP, *jump, until(Phase.DISARMED), wait(1.0)])
    down_s = flight.loop.flight.since_s
    assert [at_s for at_s, _ in told[0] if at_s < down_s] == []
    assert len([at_s for at_s, _ in told[0] if at_s > down_s]) > 20, "the next preflight looks for vision"


async def test_poses_that_go_wrong_while_the_autopilot_lands_are_withheld_from_it() -> None:
    told: list[list[tuple[float, Array]]] = []
    listen = do(lambda flight: told.append(poses_of(flight)))
    handed = [inject("autopilot wrong (battery critical)"), until(Phase.HANDED_OVER), wait(0.3), listen, wait(0.2)]
    flight = await fly([*QUICK_UP, *handed, inject("mocap wrong (swapped)"), wait(2.0)])
    assert flight.autopilot.status().mode is FlightMode.LAND
    assert 5 < len(told[0]) < 15, "as long as they were its own"
    assert max(float(np.abs(place_w_m[:2]).max()) for _, place_w_m in told[0]) < 0.3


async def test_frames_that_all_bear_the_same_number_are_all_used() -> None:
    def number_them_all_one(flight: Flight) -> None:
        mocap: Any = flight.loop._mocap
        latest: Callable[[], MocapFrame | None] = mocap.latest

        def numbered() -> MocapFrame | None:
            frame = latest()
            return None if frame is None else replace(frame, frame=1)

        mocap.latest = numbered

    flight = await fly([do(number_them_all_one), *QUICK_UP, wait(1.0)])
    assert flight.phase is Phase.HOLD
    assert len([tick for tick in flight.ticks if np.isfinite(tick.frame_received_s)]) > 0.95 * len(flight.ticks)
