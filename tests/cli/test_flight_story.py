"""Story told of a flight: simulated ones, tick by tick, and the words themselves."""

from dataclasses import replace

import numpy as np
import pytest

from companion.cli.demo.fault_messages import done, owner, shorter, still_there
from companion.cli.demo.flight_log import NEXT, FlightStory
from companion.core.types import FlightMode
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import HoldRequest, LandRequest, Phase, TakeoffRequest, TrackRequest
from companion.trajectories.reference import Hold
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import ARM, ask, until, wait

UP = [*ARM, ask(TakeoffRequest(0.4)), until(Phase.HOLD)]
TASK = Hold(np.array([0.0, 0.0, 0.4]), 0.0, 3.0)
DOWN = [ask(LandRequest()), until(Phase.DISARMED), wait(0.1)]
TRACKING = [*UP, ask(TrackRequest(TASK, 0.0)), until(Phase.TRACK)]


def told(flight: Flight, lands_at: int | None = None) -> tuple[list[str], FlightStory]:
    """The lines; `lands_at` is the tick at which whoever commands it says that this is the plan's landing."""
    story, lines = FlightStory(), []
    for number, tick in enumerate(flight.ticks):
        story.ours = story.ours or number == lands_at
        lines += [line.plain.strip() for line in story.take(tick)]
    return lines, story


async def flown(*script: Step, faults: tuple[str, ...] = ()) -> tuple[list[str], FlightStory]:
    return told(await fly(list(script), faults=faults))


def only(lines: list[str], word: str) -> str:
    [line] = [line for line in lines if word in line]
    return line


async def test_a_flight_as_planned_tells_its_phases_and_ends_without_a_word() -> None:
    flight = await fly([*TRACKING, until(Phase.HOLD), wait(0.3), *DOWN])
    holding = max(number for number, tick in enumerate(flight.ticks) if tick.flight.phase is Phase.HOLD)
    lines, story = told(flight, lands_at=holding)
    assert [line.split()[-1] for line in lines] == [
        "preflight", "armed", "takeoff", "hold", "track", "hold", "land", "disarmed",
    ]  # fmt: skip
    assert story.completed
    assert story.ending() == ""


async def test_an_operators_hold_is_no_end_of_the_trajectory() -> None:
    lines, story = await flown(*TRACKING, wait(1.0), ask(HoldRequest()), wait(0.3), *DOWN)
    assert only(lines, "operator ordered it; abort").endswith(
        "hold: the operator ordered it; abort or land brings it down"
    )
    assert story.held
    assert not story.completed
    assert story.ending().startswith("ended by the operator after 1 of 3 s; landed, disarmed at ")


async def test_a_landing_that_the_operator_orders_is_told_as_that() -> None:
    lines, story = await flown(*UP, wait(0.2), ask(LandRequest("the operator aborted")), until(Phase.DISARMED))
    assert only(lines, "land:").endswith("land: the operator ordered it")
    assert story.ending().startswith("ended by the operator before its task; landed, disarmed at ")


async def test_a_fault_is_named_once_with_what_is_done_and_what_is_next_and_later_ones_are_told_too() -> None:
    faults = ("mocap stuck at 3 s", "autopilot wrong (battery critical) at 3.5 s")
    lines, story = await flown(*UP, until(Phase.HANDED_OVER), until(Phase.DISARMED), faults=faults)
    reaction = only(lines, "mocap frozen")
    assert "mocap frozen: the pose is the same to the last bit for 0.1" in reaction
    assert reaction.endswith(" s -> PX4 lands it")
    ending, at = story.ending(), reaction.split(" s ")[0]
    assert ending.startswith(f"ended by mocap frozen at {at} s; PX4 landed it, disarmed at ")
    assert ending.endswith(f" s. {NEXT}")
    assert ending.count("mocap frozen") == 1
    assert not [line for line in lines if line.endswith("handed over")], "the reaction says it"
    assert lines.index(only(lines, "battery critical: ")) > lines.index(reaction)


async def test_a_pilot_who_takes_it_is_told_from_a_landing() -> None:
    flight = await fly(
        [*UP, until(Phase.HANDED_OVER), wait(0.3)], faults=("autopilot wrong (pilot takes over) at 3 s",)
    )
    lines, story = told(flight)
    assert only(lines, "mode changed").endswith("-> nothing more is sent: the pilot has it (mode position)")
    assert story.last is not None
    still = still_there(story.last, "the autopilot is still armed")
    assert still == (
        "the vehicle is STILL FLYING at 0.4 m: the pilot has it (mode position); this program no longer watches it"
    )
    assert still in story.ending(still)
    gone = replace(story.last, status=replace(story.last.status, connected=False))
    assert still_there(gone, "the autopilot is not heard any more") == "the autopilot is not heard any more"
    stands = replace(story.last, status=replace(story.last.status, in_air=False))
    assert still_there(stands, "why") == "the vehicle is STILL ARMED on the ground: why"
    unseen = replace(story.last, age_s=np.inf)
    assert still_there(unseen, "").startswith("the vehicle is STILL FLYING: ")


async def test_nothing_is_called_a_flight_that_was_none() -> None:
    _, story = await flown(*ARM, until(Phase.DISARMED), faults=("mocap off armed after 1 s",))
    assert story.ending().startswith(
        "stopped before it flew, by mocap silent; the motors stopped on the ground, disarmed."
    )


async def test_why_it_did_not_lift_off_is_told() -> None:
    flight = await fly([*ARM, ask(TakeoffRequest(1.2)), until(Phase.DISARMED)], plant={"max_thrust_n": 70.0})
    lines, story = told(flight)
    assert "lift-off not seen: no lift-off seen at thrust 0.62" in only(lines, "no lift-off")
    assert story.ending().startswith("stopped before it flew, by lift-off not seen at ")


def test_what_servos_say_alike_is_said_once() -> None:
    says = "has not answered for 0.30 s: look at its cable and its supply, then clear the faults and switch torque on"
    silent = "; ".join(f"right.joint (ID {number}) {says}" for number in (1, 2, 3, 4, 7, 8))
    assert shorter(silent) == (
        "6 of 8 servos (IDs 1-4, 7, 8) have not answered for 0.30 s: look at their cable and their supply, then clear "
        "the faults and switch torque on"
    )
    later = silent.replace("0.30", "0.31", 1)
    assert shorter(later).count("answered") == 1, "not the same to the last digit, but the same"
    one = "left.claw (ID 8) is overloaded and still holds: take the load away, then clear"
    assert shorter(one) == one
    assert shorter(f"{one}; {silent}; bus: no servo was read for 0.6 s").count("; ") == 2
    assert shorter("nothing of servos") == "nothing of servos"


@pytest.mark.parametrize(
    ("cause", "mode", "words"),
    [
        (Fault.AUTOPILOT_SILENT, FlightMode.OFFBOARD, "nothing was heard from the autopilot"),
        (Fault.AUTOPILOT_REBOOTED, FlightMode.OTHER, "the autopilot rebooted, its motors off"),
        (Fault.MODE_CHANGED, FlightMode.POSITION, "from then on the pilot had it (mode position)"),
        (Fault.MODE_CHANGED, FlightMode.LAND, "from then on PX4 itself had it (mode land)"),
    ],
)
def test_who_had_it_is_told(cause: Fault, mode: FlightMode, words: str) -> None:
    assert done(FailsafeAction.RELEASE, cause, mode, over=True) == words
    assert done(FailsafeAction.AUTOPILOT_LAND, cause, mode, over=False) == "PX4 was told to land"
    assert "nobody has it" in owner(FlightMode.OFFBOARD)
