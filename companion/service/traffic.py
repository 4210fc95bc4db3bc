"""Ways of the vehicles of one room, compared before one begins, and the announcement of this vehicle's own."""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from companion.config.separation_config import ANY_HEIGHT_M, SeparationConfig
from companion.core.errors import FlightError
from companion.core.types import Array, OtherVehicle
from companion.flight.flight_loop import FlightLoop
from companion.protocol.intent import MOST_KNOTS, Intent
from companion.supervisor.flight_state import FlightRules, FlightState, TrackRequest
from companion.supervisor.separation import objection
from companion.supervisor.state_machine import reference_at
from companion.trajectories.encounter import Crossing, Cylinder, Meeting, crossing, meeting
from companion.trajectories.timed_path import TimedPath, sampled

_SEEN_STEP_S = 0.1
"""Time between two points of a way that is compared with the vehicles that are seen."""
_MILLIMETRE = 3
"""Decimals of the positions and times that are announced."""


@dataclass(frozen=True)
class Way:
    """Way of one command that was compared with all announced ones."""

    path: TimedPath | None = None
    """None where there is no separation, or nothing to compare."""
    note: str = ""
    """Crossings at other times, as a sentence for the operator; empty without one."""


class Traffic:
    """Ways of the other vehicles of [separation], and the own one. Without separation it says and rejects nothing."""

    def __init__(
        self,
        separation: SeparationConfig,
        body: str,
        session: str,
        announce: Callable[[Intent | None], None],
        intents: Callable[[], Sequence[Intent]],
        rules: FlightRules,
    ) -> None:
        """`announce` publishes the own way, `intents` returns those of the vehicles that are heard now.

        Of the vehicles that are seen it keeps as clear as `rules` ask of every way that begins.
        """
        self._order, self._body, self._session = separation.order, body, session
        self._cylinder = Cylinder(separation.radius_m, separation.height_m)
        self._clear, self._clear_ahead_s = rules.keep_clear, rules.clear_ahead_s
        self._announce, self._intents = announce, intents

    async def way(self, loop: FlightLoop, request: TrackRequest) -> Way:
        """Compare the way that a request would lead with those of the others; raise FlightError where they meet.

        A request that is refused for another reason is not compared.
        """
        if not self._order or loop.refusal(request):
            return Way()
        flight, vehicle = loop.preview(request), loop.estimate.vehicle
        return await asyncio.to_thread(self._compared, flight, () if vehicle is None else vehicle.others)

    def _compared(self, flight: FlightState, others: Sequence[OtherVehicle]) -> Way:
        path, notes = _path_of(flight), []
        self._require_clear(path, others)
        for intent in self._intents():
            if intent.body == self._body or intent.body not in self._order:
                continue
            other = _path_from(intent, time.time())
            met = meeting(path, other, self._cylinder)
            if met is not None:
                raise FlightError(self._rejection(intent, met))
            crossed = crossing(path, other, self._cylinder)
            if crossed is not None:
                notes.append(self._note(intent, crossed))
        return Way(path, "; ".join(notes))

    def _require_clear(self, path: TimedPath, others: Sequence[OtherVehicle]) -> None:
        """Raise FlightError where a way, as a whole, leads too near another vehicle as motion capture sees it now."""
        times_s = np.arange(0.0, path.times_s[-1] + _SEEN_STEP_S, _SEEN_STEP_S)
        points = tuple((x, y, z) for x, y, z in path.at(times_s).tolist())
        clear = self._clear
        why = "" if clear is None else objection(points, _SEEN_STEP_S, others, clear, self._clear_ahead_s)
        if why:
            raise FlightError(f"another vehicle is in the way: {why}")

    def _rejection(self, intent: Intent, met: Meeting) -> str:
        return (
            f"this way would come within {met.distance_m:.2f} m of {intent.body}'s {intent.verb} at "
            f"{_words(met.position_w_m)}, {max(met.time_s, 0.0):.0f} s from now, and {_least(self._cylinder)} is the "
            f"least: wait until {intent.body} has finished, or fly elsewhere"
        )

    def _note(self, intent: Intent, crossed: Crossing) -> str:
        later, after_s = crossed.after_s >= 0.0, abs(crossed.after_s)
        yields = max(self._body, intent.body, key=self._order.index)
        return (
            f"it crosses {intent.body}'s {intent.verb} at {_words(crossed.position_w_m)}, {after_s:.0f} s "
            f"{'after' if later else 'before'} it; {yields} yields if they meet"
        )

    def begin(self, verb: str, way: Way) -> None:
        """Announce the way of a command that has begun."""
        if way.path is None:
            return
        rows = np.column_stack([way.path.times_s, way.path.positions_w_m]).round(_MILLIMETRE).tolist()
        knots = tuple((t_s, x_m, y_m, z_m) for t_s, x_m, y_m, z_m in rows)
        self._announce(Intent(session=self._session, body=self._body, verb=verb, from_s=time.time(), knots=knots))

    def end(self, way: Way) -> None:
        """Take the announcement of a command back."""
        if way.path is not None:
            self._announce(None)


def no_traffic() -> Traffic:
    """Return the traffic of a room with one vehicle."""
    return Traffic(SeparationConfig(), "", "", lambda _: None, tuple, FlightRules())


def _path_of(flight: FlightState) -> TimedPath:
    """Return the way of a flight from the start of its first leg; times count from there."""
    start_s, duration_s = flight.leg_start_s, sum(leg.trajectory.duration_s for leg in flight.legs)
    return sampled(lambda time_s: reference_at(flight, start_s + time_s).position_w_m, duration_s, MOST_KNOTS)


def _path_from(intent: Intent, now_s: float) -> TimedPath:
    """Return an announced way; its times count from `now_s`, Unix time."""
    rows = np.array(intent.knots)
    return TimedPath(rows[:, 0] + intent.from_s - now_s, rows[:, 1:])


def _least(cylinder: Cylinder) -> str:
    height = "at any height" if cylinder.height_m >= ANY_HEIGHT_M else f"or {cylinder.height_m:g} m of height"
    return f"{cylinder.radius_m:g} m ({height})"


def _words(position_w_m: Array) -> str:
    return "x {:.2f} y {:.2f} z {:.2f} m".format(*position_w_m.tolist())
