"""Flights brought into every state of the phase machine, by the machine itself, and the facts that go with them."""

import dataclasses
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.core.types import FlightMode
from companion.supervisor import state_machine
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import (
    Action,
    ArmRequest,
    FlightInputs,
    FlightRules,
    FlightState,
    HandOverRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.state_machine import advance, reference_at
from companion.trajectories.reference import Ellipse, Trajectory

RULES = FlightRules()
DT_S = 0.01
GROUND = np.array([1.0, 2.0, 0.1])
CENTRE = np.array([0.0, 0.0, 1.2])
CURVE: Trajectory = Ellipse(CENTRE)


def apply_request(flight: FlightState, wanted: Request, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Return the flight after a request; unchanged when it is rejected."""
    return state_machine.apply_request(flight, wanted, inputs, rules)[0]


def event(fault: Fault, text: str = "") -> Event:
    return Event(fault, text or f"{fault} it is")


def facts(
    time_s: float,
    height_m: float = 0.0,
    *faults: Fault,
    climb_mps: float = 0.0,
    armed: bool = True,
    mode: FlightMode = FlightMode.OFFBOARD,
) -> FlightInputs:
    """A vehicle above its ground, with these faults there."""
    position = GROUND + np.array([0.0, 0.0, height_m])
    events = tuple(event(fault) for fault in faults)
    return FlightInputs(
        time_s=time_s,
        position_w_m=position,
        velocity_w_mps=np.array([0.0, 0.0, climb_mps]),
        yaw_rad=0.3,
        armed=armed,
        mode=mode,
        events=events,
    )


def with_faults(seen: FlightInputs, *faults: Fault) -> FlightInputs:
    return replace(seen, events=tuple(event(fault) for fault in faults))


def on_reference(flight: FlightState, time_s: float) -> FlightInputs:
    """The vehicle exactly where it should be, on the ground at the lowest."""
    if not flight.airborne:
        return facts(time_s, 0.0)
    ref = reference_at(flight, time_s)
    at_ground = np.maximum(ref.position_w_m, [-np.inf, -np.inf, GROUND[2]])
    velocity = ref.velocity_w_mps if ref.position_w_m[2] >= GROUND[2] else np.zeros(3)
    return replace(facts(time_s), position_w_m=at_ground, velocity_w_mps=velocity)


def until(
    flight: FlightState, time_s: float, done: Callable[[FlightState], bool], within_s: float = 60.0
) -> tuple[FlightState, float]:
    """Tick with the vehicle on its reference until `done`."""
    end_s = time_s + within_s
    while not done(flight):
        assert time_s < end_s, f"still {flight.phase} after {within_s} s"
        time_s += DT_S
        flight = advance(flight, on_reference(flight, time_s), RULES)
    return flight, time_s


def preflight() -> FlightState:
    return apply_request(FlightState(), ArmRequest(), facts(0.0, armed=False), RULES)


def armed() -> FlightState:
    return advance(preflight(), facts(0.1), RULES)


def spooling() -> FlightState:
    return apply_request(armed(), TakeoffRequest(1.2), facts(1.0), RULES)


def climbing() -> FlightState:
    return advance(spooling(), facts(2.5, 0.05, climb_mps=0.2), RULES)


def hovering() -> tuple[FlightState, float]:
    return until(climbing(), 2.5, lambda flight: flight.phase is Phase.HOLD)


def _asked(state: tuple[FlightState, float], wanted: Request) -> tuple[FlightState, float]:
    flight, time_s = state
    return apply_request(flight, wanted, on_reference(flight, time_s), RULES), time_s


def _hit(state: tuple[FlightState, float], fault: Fault) -> tuple[FlightState, float]:
    flight, time_s = state
    return advance(flight, with_faults(on_reference(flight, time_s + DT_S), fault), RULES), time_s + DT_S


def approaching() -> tuple[FlightState, float]:
    return _asked(hovering(), TrackRequest(CURVE, 1.0))


def tracking() -> tuple[FlightState, float]:
    flight, time_s = until(*approaching(), lambda now: now.phase is Phase.TRACK)
    full_speed_s = time_s + 5.0
    while time_s < full_speed_s:
        time_s += DT_S
        flight = advance(flight, on_reference(flight, time_s), RULES)
    return flight, time_s


def descending() -> tuple[FlightState, float]:
    return _asked(hovering(), LandRequest())


def stowing() -> tuple[FlightState, float]:
    flight, time_s = tracking()
    return apply_request(flight, LandRequest(), replace(on_reference(flight, time_s), arms_stowed=False), RULES), time_s


def touched_down() -> tuple[FlightState, float]:
    flight, time_s = descending()
    return until(flight, time_s, lambda now: now.touched_down)


def given_up() -> tuple[FlightState, float]:
    return _asked(hovering(), HandOverRequest("it broke"))


def resuming() -> tuple[FlightState, float]:
    flight, time_s = _hit(hovering(), Fault.MODE_CHANGED)
    time_s += 1.0
    return apply_request(flight, ResumeRequest(), facts(time_s, 1.0, mode=FlightMode.POSITION), RULES), time_s


STATES: dict[str, tuple[FlightState, float]] = {
    "standby": (FlightState(), 0.0),
    "preflight": (preflight(), 0.1),
    "armed": (armed(), 0.5),
    "stopping": _hit((armed(), 0.5), Fault.MOCAP_SLOW),
    "spooling up": (spooling(), 1.5),
    "climbing": (climbing(), 5.0),
    "hovering": hovering(),
    "approaching": approaching(),
    "tracking": tracking(),
    "held by a fault": _hit(tracking(), Fault.FENCE_NEAR),
    "stowing": stowing(),
    "descending": descending(),
    "landing by a fault": _hit(tracking(), Fault.BATTERY_LOW),
    "touched down": touched_down(),
    "disarmed": (apply_request(preflight(), LandRequest(), facts(0.2, armed=False), RULES), 0.3),
    "handed over": given_up(),
    "let go": _hit(hovering(), Fault.AUTOPILOT_SILENT),
    "resuming": resuming(),
    "terminated": _asked(hovering(), KillRequest()),
}
IN_THE_AIR = [
    "climbing", "hovering", "approaching", "tracking", "held by a fault", "stowing", "descending", "landing by a fault",
]  # fmt: skip
ON_THE_GROUND = ["armed", "spooling up", "stopping", "touched down"]
COMMANDED = IN_THE_AIR + ON_THE_GROUND


def usual(state: str, later_s: float = DT_S) -> FlightInputs:
    """Return what is seen in a state as long as nothing happens."""
    flight, time_s = STATES[state]
    seen = on_reference(flight, time_s + later_s)
    if flight.phase in {Phase.HANDED_OVER, Phase.RESUME, Phase.TERMINATED}:
        seen = facts(time_s + later_s, 1.0)
    if flight.phase in {Phase.STANDBY, Phase.PREFLIGHT, Phase.DISARMED}:
        return replace(seen, armed=False, mode=FlightMode.POSITION)
    if state in {"handed over", "let go"}:
        return replace(seen, mode=FlightMode.LAND)
    return replace(seen, mode=FlightMode.POSITION) if flight.phase is Phase.RESUME else seen


def bits(value: object) -> object:
    """For comparing bit for bit: a Flight holds arrays, which have no truth value."""
    if dataclasses.is_dataclass(value):
        return type(value), [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return [bits(one) for one in value] if isinstance(value, tuple) else value


def end_of(flight: FlightState) -> tuple[Phase, Action | None]:
    return flight.phase, flight.action
