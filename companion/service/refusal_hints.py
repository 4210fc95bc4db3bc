"""Remedies for commands that are refused in the present phase of the flight."""

from companion.supervisor.flight_state import HoldRequest, Phase, Request, ResumeRequest, TakeoffRequest, TrackRequest

_ON_GROUND = (Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED)
_LANDING = dict.fromkeys(
    (Phase.STOW, Phase.LAND), "the vehicle is landing; wait until it is down, then run `companion arm`"
)
_NOT_IN_CONTROL = _LANDING | {
    Phase.HANDED_OVER: "the autopilot or its pilot has the vehicle; run `companion resume` first"
}
_REMEDIES: dict[type[Request], dict[Phase, str]] = {
    TakeoffRequest: _NOT_IN_CONTROL
    | dict.fromkeys(_ON_GROUND, "the vehicle is disarmed; run `companion arm` first")
    | dict.fromkeys((Phase.TAKEOFF, Phase.HOLD, Phase.TRACK), "the vehicle flies already; run `companion goto`")
    | {Phase.PREFLIGHT: "wait until it is armed"},
    TrackRequest: _NOT_IN_CONTROL
    | dict.fromkeys(_ON_GROUND, "the vehicle is disarmed; run `companion arm`, then `companion takeoff` first")
    | dict.fromkeys((Phase.PREFLIGHT, Phase.ARMED), "the vehicle is on the ground; run `companion takeoff` first")
    | dict.fromkeys((Phase.TAKEOFF, Phase.RESUME), "wait until the vehicle hovers"),
    HoldRequest: _NOT_IN_CONTROL
    | dict.fromkeys((*_ON_GROUND, Phase.PREFLIGHT, Phase.ARMED), "the vehicle is on the ground"),
    ResumeRequest: dict.fromkeys(
        set(Phase) - {Phase.HANDED_OVER}, "this service has the vehicle; there is nothing to take back"
    ),
}


def remedy_for(request: Request, phase: Phase) -> str:
    """Return the state and the remedy for a refused request; empty where there is none."""
    return _REMEDIES.get(type(request), {}).get(phase, "")
