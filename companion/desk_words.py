"""What an operator has to say first, when a command does not fit the flight's phase."""

from companion.supervisor.flight import Brake, Fly, Phase, Request, Resume, TakeOff

_DOWN = (Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED)
_ENDS = dict.fromkeys((Phase.STOW, Phase.LAND), "it is landing: wait until it is down, then say arm")
_AIR = _ENDS | {Phase.HANDED_OVER: "somebody else has the vehicle: say resume first"}
_FIRST: dict[type[Request], dict[Phase, str]] = {
    TakeOff: _AIR
    | dict.fromkeys(_DOWN, "say arm first")
    | dict.fromkeys((Phase.TAKEOFF, Phase.HOLD, Phase.TRACK), "it flies already: say goto")
    | {Phase.PREFLIGHT: "wait until it is armed"},
    Fly: _AIR
    | dict.fromkeys(_DOWN, "say arm, then takeoff first")
    | dict.fromkeys((Phase.PREFLIGHT, Phase.ARMED), "say takeoff first")
    | dict.fromkeys((Phase.TAKEOFF, Phase.RESUME), "wait until it hovers"),
    Brake: _AIR | dict.fromkeys((*_DOWN, Phase.PREFLIGHT, Phase.ARMED), "it stands"),
    Resume: dict.fromkeys(set(Phase) - {Phase.HANDED_OVER}, "we have it: there is nothing to take back"),
}


def first(wanted: Request, phase: Phase) -> str:
    """For the end of a sentence, after the reason; empty where nothing helps."""
    return _FIRST.get(type(wanted), {}).get(phase, "")
