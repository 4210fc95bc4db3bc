"""Faults in whole flights in simulated time: scripted, ordered by the flight's script, and the same again."""

import numpy as np
import pytest

from companion.core.types import FlightMode
from companion.supervisor.flight_state import Phase
from tests.flights.simulated import Flight, fly
from tests.flights.test_simulated_flights import UP, wait

pytestmark = pytest.mark.slow


def _inject(flight: Flight) -> bool:
    flight.room.inject("link intermittent (from the autopilot) by 0.5 for 1 s")
    return True


async def test_scripted_and_ordered_faults_happen_in_flight_and_the_same_way_again() -> None:
    script = [*UP, _inject, wait(1.5)]
    faults = ["mocap intermittent by 0.2 at 1 s", "mocap stuck at 7.5 s for 0.1 s"]
    one, again = await fly(script, faults=faults), await fly(script, faults=faults)
    told = [(turn.begins, str(turn.fault.part), str(turn.fault.kind)) for turn in one.room.fault_turns]
    assert (True, "mocap", "intermittent") in told
    assert {(True, "link", "intermittent"), (False, "link", "intermittent")} <= set(told)
    assert np.array(one.truths_w_m).tobytes() == np.array(again.truths_w_m).tobytes()
    assert one.room.fault_turns == again.room.fault_turns


async def test_the_companion_sees_what_the_autopilot_says_of_itself() -> None:
    faults = ["autopilot wrong (battery low) to 0.6 at 1 s", "autopilot wrong (pilot takes over) at 7 s"]
    flight = await fly([*UP, wait(1.0), lambda flight: flight.phase is not Phase.HOLD, wait(0.5)], faults=faults)
    taken_s = flight.room.fault_turns[-1].time_s
    seen = next(tick for tick in flight.ticks if tick.status.mode is FlightMode.POSITION)
    assert 0.0 <= seen.time_s - taken_s < 0.08, "CURRENT_MODE at 20 Hz, not the next HEARTBEAT"
    status = seen.status
    assert 0.5 < status.battery_fraction <= 0.6, "it drains on"
    assert 0.0 <= seen.time_s - status.heard_s < 0.02
    assert 0.0 <= seen.time_s - status.boot_s < 0.05, "this autopilot booted when the clock began"
    assert seen.vehicle is not None
    assert abs(float(status.q_w_flu_wxyz @ seen.vehicle.q_w_flu_wxyz)) > 0.9995
