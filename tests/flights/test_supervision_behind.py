"""Supervision behind the setpoint: what it finds, and what is done about it, comes in the same cycle as before it."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest

from companion.control.pipeline import same_setpoint
from companion.flight.flight_loop import FlightLoop
from companion.flight.setpoint_stream import SetpointStream
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import LandRequest, Phase
from tests.flights.faults import acts
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import QUICK_UP, ask, inject, until, wait

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Onset:
    """Something that begins without a cycle that would be checked first."""

    fault: Fault
    act: Step
    phase: Phase


def gust(force_w_n: tuple[float, float, float], for_s: float) -> Step:
    def step(flight: Flight) -> bool:
        acts.gust(force_w_n, for_s)(flight)
        return True

    return step


ALONG_THE_LEGS = {Phase.TAKEOFF, Phase.HOLD, Phase.TRACK}
ONSETS = [
    Onset(Fault.TRACKING_ERROR, gust((24.0, 0.0, 0.0), 0.7), Phase.LAND),
    Onset(Fault.BATTERY_CRITICAL, inject("autopilot wrong (battery critical)"), Phase.HANDED_OVER),
    Onset(Fault.HORIZON_WRONG, inject("autopilot wrong (attitude off) by 0.4 rad"), Phase.LAND),
]
"""Two reactions of our own, which change the next setpoint, and one that tells the autopilot at once."""


async def flown(onset: Onset) -> Flight:
    def reacted(flight: Flight) -> bool:
        return flight.phase is onset.phase

    return await fly([*QUICK_UP, wait(0.3), onset.act, reacted, wait(0.05)])


def first_with_events(flight: Flight) -> int:
    """Return the first cycle in the air that found something."""
    ticks = enumerate(pairwise(flight.ticks), 1)
    return next(index for index, (last, tick) in ticks if last.flight.airborne and tick.events)


@pytest.mark.parametrize("onset", ONSETS, ids=lambda onset: onset.fault.name)
async def test_a_fault_is_found_and_answered_in_the_same_cycle(onset: Onset, monkeypatch: pytest.MonkeyPatch) -> None:
    behind = await flown(onset)
    monkeypatch.setattr(FlightLoop, "_may_supervise_behind", lambda *_: False)
    first = await flown(onset)
    at = first_with_events(first)
    assert first_with_events(behind) == at
    for one, other in zip(behind.ticks[: at + 1], first.ticks[: at + 1], strict=True):
        assert (one.events, one.flight.phase, one.flight.reason) == (
            other.events,
            other.flight.phase,
            other.flight.reason,
        )
        assert one.flight.action is other.flight.action
    for one, other in zip(behind.ticks[:at], first.ticks[:at], strict=True):
        assert (one.limited is None) == (other.limited is None)
        if one.limited is not None and other.limited is not None:
            assert same_setpoint(one.limited.setpoint, other.limited.setpoint)
    found = behind.ticks[at]
    assert (found.flight.phase, found.flight.cause) == (onset.phase, onset.fault)
    assert found.pipeline is not None, "its setpoint is still the phase's before"
    assert (behind.ticks[at + 1].pipeline is None) == (onset.phase is Phase.HANDED_OVER)


def note(monkeypatch: pytest.MonkeyPatch, owner: type, name: str, noted: list[str]) -> None:
    """Note each call of a method before it is made."""
    real = getattr(owner, name)

    def call(*given: Any) -> Any:
        noted.append(name)
        return real(*given)

    monkeypatch.setattr(owner, name, call)


async def test_only_where_nothing_is_wrong_and_nothing_has_happened(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for owner, name in ((FlightLoop, "_supervise"), (SetpointStream, "send"), (FlightLoop, "_tell")):
        note(monkeypatch, owner, name, calls)
    flight = await fly([*QUICK_UP, inject("mocap off for 0.1 s"), wait(0.4), ask(LandRequest()), until(Phase.DISARMED)])
    cycles = " ".join(calls).split("_tell")
    behind = [index for index, cycle in enumerate(cycles) if cycle.split()[:2] == ["send", "_supervise"]]
    usual = {
        index
        for index, (last, tick) in enumerate(pairwise(flight.ticks), 1)
        if last.flight.airborne and last.flight.phase in ALONG_THE_LEGS and tick.frame is not None and not last.events
    }
    assert set(behind) <= usual
    assert len(behind) > 0.95 * len(usual) > 100
    assert any(tick.events for tick in flight.ticks if tick.flight.airborne)
