"""Requests that a phase does not allow, each with the state of the vehicle and what to do."""

from companion.supervisor.flight_state import (
    COMMANDED,
    IN_THE_AIR,
    INACTIVE,
    ArmRequest,
    HandOverRequest,
    HoldRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)

_BEFORE_TAKEOFF = frozenset({Phase.PREFLIGHT, Phase.ARMED})
_ON_GROUND = "the vehicle is on the ground"
_NOT_IN_CONTROL = {
    **dict.fromkeys((Phase.STOW, Phase.LAND), "the vehicle is landing; wait until it is disarmed"),
    Phase.HANDED_OVER: "the autopilot or its pilot has the vehicle; run `companion resume` first",
    Phase.RESUME: "the vehicle is being taken back; wait until it hovers",
}
REJECTIONS: dict[type[Request], dict[Phase, str]] = {
    ArmRequest: {
        **dict.fromkeys(IN_THE_AIR | {Phase.RESUME}, "the vehicle is in the air; run `companion land` first"),
        Phase.ARMED: "the vehicle is armed; run `companion takeoff`, or `companion disarm` to stop the motors",
        Phase.HANDED_OVER: "the autopilot or its pilot has the vehicle; wait until it is disarmed",
    },
    TakeoffRequest: {
        **dict.fromkeys(IN_THE_AIR, "the vehicle is in the air; run `companion goto` to climb"),
        **_NOT_IN_CONTROL,
        **dict.fromkeys(INACTIVE, "the vehicle is disarmed; run `companion arm` first"),
        Phase.PREFLIGHT: "the vehicle is being armed; wait until it is armed",
    },
    TrackRequest: {
        **_NOT_IN_CONTROL,
        **dict.fromkeys(INACTIVE, "the vehicle is disarmed; run `companion arm`, then `companion takeoff` first"),
        **dict.fromkeys(_BEFORE_TAKEOFF, f"{_ON_GROUND}; run `companion takeoff` first"),
        Phase.TAKEOFF: "the vehicle is climbing; wait until it hovers",
    },
    HoldRequest: {**_NOT_IN_CONTROL, **dict.fromkeys(INACTIVE | _BEFORE_TAKEOFF, _ON_GROUND)},
    LandRequest: dict.fromkeys(INACTIVE, f"{_ON_GROUND}, and this service does not fly it"),
    HandOverRequest: dict.fromkeys(set(Phase) - COMMANDED - {Phase.RESUME}, "this service does not fly the vehicle"),
    ResumeRequest: dict.fromkeys(
        set(Phase) - {Phase.HANDED_OVER}, "this service has the vehicle; there is nothing to take back"
    ),
    KillRequest: {},
}
"""Reason why a request is rejected, by request and phase; a phase that is absent accepts it."""
