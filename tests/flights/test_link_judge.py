"""The judge of a law on the ground finds what must not be, in flights made up for it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.geometry.frames import quat_from_rotation_vector
from companion.supervisor.flight_state import Phase
from tests.flights.faults.watch_link import link_problems
from tests.flights.simulated_ground import VEHICLE, Datagram

ACCEL = (0.5, 0.0, 0.25)


def tick(time_s: float, accel: tuple[float, ...] = ACCEL, tilt_rad: float = 0.0, phase: Phase = Phase.HOLD) -> Any:
    q = quat_from_rotation_vector(np.array([tilt_rad, 0.0, 0.0]))
    return SimpleNamespace(
        time_s=time_s,
        flight=SimpleNamespace(airborne=True, phase=phase),
        limited=SimpleNamespace(setpoint=SimpleNamespace(q_w_flu_wxyz=q)),
        pipeline=SimpleNamespace(law_output=SimpleNamespace(accel_w_mps2=np.array(accel))),
    )


def flight(*ticks: Any, confirms: bool = True) -> Any:
    """Return a flight in which one message arrives at 10 s, 4 ms after it was sent."""
    sent = SimpleNamespace(flown=SimpleNamespace(sent=SimpleNamespace(accel_w_mps2=ACCEL)))
    ground = SimpleNamespace(ticks=[sent, SimpleNamespace(flown=None)])
    message = Datagram(b"", ("ground", 1), VEHICLE, 9.996, confirms)
    return SimpleNamespace(ticks=list(ticks), ground=SimpleNamespace(heard=[(10.0, message)], all_grounds=[ground]))


def test_a_flight_by_a_law_on_board_is_not_judged() -> None:
    assert link_problems(SimpleNamespace(ground=None)) == ()  # type: ignore[arg-type]


def test_fresh_commands_and_a_landing_in_time_are_well() -> None:
    ticks = [tick(10.0, tilt_rad=0.3), tick(10.19, tilt_rad=0.1), tick(10.29), tick(11.0, phase=Phase.HANDED_OVER)]
    assert link_problems(flight(*ticks)) == ()
    assert link_problems(flight(tick(10.1, (0.0, 0.0, 0.0)))) == (), "level, before the first command"


@pytest.mark.parametrize(
    ("bad", "problem"),
    [
        (tick(10.31), "the vehicle was still flown 0.314 s after the last command"),
        (tick(10.25, tilt_rad=0.07), "a tilt of 0.070 rad stood 0.2 s after the last command"),
        (tick(10.1, (0.5, 0.0, 0.3)), "1 commands were flown that no ground law of this flight has sent"),
    ],
)
def test_what_must_not_be_is_found(bad: Any, problem: str) -> None:
    assert link_problems(flight(tick(10.0), bad)) == (problem,)


def test_messages_that_confirm_nothing_do_not_count() -> None:
    [problem] = link_problems(flight(tick(10.0), confirms=False))
    assert problem.startswith("the vehicle was still flown inf s")
