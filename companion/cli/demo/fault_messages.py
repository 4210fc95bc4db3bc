"""Fault messages for the operator: the fault, the reaction, who controls the vehicle. Pure."""

import math
import re

from companion.arms.model import JOINT_COUNT
from companion.core.types import FlightMode
from companion.flight.tick import Tick
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import FlightState

_SERVO = re.compile(r"\S+ \(ID (?P<id>\d+)\) (?P<says>.*)")
_NEXT_SERVO = re.compile(r"; (?=\S+ \(ID \d+\) |bus: |the arms. )")
_NUMBERS = re.compile(r"\d+(?:\.\d+)?")
_MANY = {"is": "are", "has": "have", "reports": "report", "holds": "hold", "its": "their", "it": "they"}
_PILOTS = frozenset({FlightMode.POSITION, FlightMode.ALTITUDE, FlightMode.MANUAL})
_LANDINGS = frozenset({FlightMode.LAND, FlightMode.RETURN})
_SEEN_S = 0.5

_NOW = {
    FailsafeAction.HOLD: "it brakes and hovers",
    FailsafeAction.LAND: "it lands",
    FailsafeAction.DISARM: "the motors stop",
    FailsafeAction.AUTOPILOT_LAND: "PX4 lands it",
    FailsafeAction.TERMINATE: "the motors are stopped",
}
_LET_GO = {
    Fault.AUTOPILOT_SILENT: "nothing more is sent: if PX4 lives, its offboard-loss failsafe lands it",
    Fault.AUTOPILOT_REBOOTED: "nothing more is sent: the autopilot rebooted, its motors are off",
    Fault.AUTOPILOT_DISARMED: "nothing more is sent: its motors are off",
    Fault.LAND_REFUSED: "nothing more is sent: PX4's offboard-loss failsafe lands it",
}
_PAST = {
    FailsafeAction.HOLD: "it braked and hovered, then landed",
    FailsafeAction.LAND: "it landed",
    FailsafeAction.DISARM: "the motors stopped on the ground",
    FailsafeAction.AUTOPILOT_LAND: "PX4 landed it",
    FailsafeAction.TERMINATE: "the motors were stopped",
}
_LET_GO_PAST = {
    Fault.AUTOPILOT_SILENT: "nothing was heard from the autopilot",
    Fault.AUTOPILOT_REBOOTED: "the autopilot rebooted, its motors off",
    Fault.AUTOPILOT_DISARMED: "the autopilot had stopped the motors",
    Fault.LAND_REFUSED: "PX4 was left to its offboard-loss failsafe",
}


def shorter(text: str) -> str:
    """Return a message about the arms in which equal messages of several servos are merged."""
    alike: dict[str, list[tuple[int, str]]] = {}
    others = []
    for part in _NEXT_SERVO.split(text):
        servo = _SERVO.fullmatch(part)
        if servo is None:
            others.append(part)
        else:
            alike.setdefault(_NUMBERS.sub("", servo["says"]), []).append((int(servo["id"]), part))
    return "; ".join([*(_of_servos(said) for said in alike.values()), *others])


def _of_servos(said: list[tuple[int, str]]) -> str:
    if len(said) == 1:
        return said[0][1]
    servo = _SERVO.fullmatch(said[0][1])
    assert servo is not None
    many = re.sub(r"\b[a-z]+\b", lambda word: _MANY.get(word[0], word[0]), servo["says"])
    return f"{len(said)} of {JOINT_COUNT} servos (IDs {_ranges(sorted(number for number, _ in said))}) {many}"


def _ranges(numbers: list[int]) -> str:
    """Return sorted numbers as text, with ranges for runs of three or more: 1-4, 7, 8."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def begun(flight: FlightState, mode: FlightMode) -> str:
    """Return what the flight's latest failsafe action does, in the present tense."""
    if flight.level is not FailsafeAction.RELEASE:
        return _NOW.get(flight.level, "")
    return _LET_GO.get(flight.cause) or f"nothing more is sent: {owner(mode)}" if flight.cause else owner(mode)


def done(level: FailsafeAction, cause: Fault | None, mode: FlightMode, over: bool) -> str:
    """Return what the failsafe action did. `over`: the motors have stopped; `mode`: the mode when it began."""
    if level is FailsafeAction.RELEASE:
        known = _LET_GO_PAST.get(cause) if cause else None
        return known or f"from then on {owner(mode).replace(' has ', ' had ')}"
    if not over:
        return _NOW.get(level, "").replace("PX4 lands it", "PX4 was told to land")
    return _PAST.get(level, "")


def owner(mode: FlightMode) -> str:
    """Return who controls the vehicle, by the autopilot's mode."""
    if mode in _PILOTS:
        return f"the pilot has it (mode {mode})"
    if mode in _LANDINGS:
        return f"PX4 itself has it (mode {mode})"
    if mode is FlightMode.OFFBOARD:
        return "it holds the last setpoint, nobody has it"
    return f"a pilot or a failsafe of PX4 has it (mode {mode})"


def still_there(tick: Tick, said: str) -> str:
    """Return the state of a vehicle that did not come down in time; `said` is the service's message."""
    status, ground_w_m = tick.status, tick.flight.ground_w_m
    if not status.connected or not status.armed:
        return said
    if status.in_air is False:
        return f"the vehicle is STILL ARMED on the ground: {said}"
    vehicle = tick.vehicle
    height = ""
    if vehicle is not None and tick.age_s < _SEEN_S and math.isfinite(vehicle.position_w_m[2]):
        ground_m = 0.0 if ground_w_m is None else float(ground_w_m[2])
        height = f" at {float(vehicle.position_w_m[2]) - ground_m:.1f} m"
    return f"the vehicle is STILL FLYING{height}: {owner(status.mode)}; this program no longer watches it"
