"""Path of a takeoff or a trajectory that is requested, and the other vehicles in its way. Pure."""

from companion.core.types import Vec3
from companion.supervisor.flight_state import (
    FlightInputs,
    FlightRules,
    FlightState,
    Request,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.separation import objection
from companion.supervisor.transitions import approach, reference_at

_TRACK_STEP_S = 0.1
_MOST_POINTS = 150
"""Points of a trajectory that are looked at, 1.5 ms: 15 s, after which the others will be elsewhere."""
_CLIMB_POINTS = 11


def others_in_the_way(flight: FlightState, request: Request, inputs: FlightInputs, rules: FlightRules) -> str:
    """Return why a takeoff or a trajectory is rejected for another vehicle; empty if none is in the way."""
    if rules.keep_clear is None or not inputs.others:
        return ""
    if isinstance(request, TakeoffRequest):
        path, step_s = _climb(request, inputs), request.height_m / rules.climb_speed_mps / (_CLIMB_POINTS - 1)
    elif isinstance(request, TrackRequest):
        path, step_s = _track(flight, request, inputs, rules), _TRACK_STEP_S
    else:
        path, step_s = (_place(inputs),), 1.0
    why = objection(path, step_s, inputs.others, rules.keep_clear, rules.clear_ahead_s)
    return f"another vehicle is in the way: {why}" if why else ""


def _place(inputs: FlightInputs) -> Vec3:
    x, y, z = inputs.position_w_m.tolist()
    return x, y, z


def _climb(request: TakeoffRequest, inputs: FlightInputs) -> tuple[Vec3, ...]:
    x, y, z = _place(inputs)
    return tuple((x, y, z + request.height_m * index / (_CLIMB_POINTS - 1)) for index in range(_CLIMB_POINTS))


def _track(flight: FlightState, request: TrackRequest, inputs: FlightInputs, rules: FlightRules) -> tuple[Vec3, ...]:
    """Return the way to the trajectory's start and its beginning."""
    flown = approach(flight, request, inputs, rules)
    total_s = sum(leg.trajectory.duration_s for leg in flown.legs)
    count = min(_MOST_POINTS, int(total_s / _TRACK_STEP_S) + 2)
    points = []
    for index in range(count):
        x, y, z = reference_at(flown, inputs.time_s + index * _TRACK_STEP_S).position_w_m.tolist()
        points.append((x, y, z))
    return tuple(points)
