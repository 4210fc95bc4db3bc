"""Observers: at the mock, where the vehicle really is and what it really gets; in the companion, what was said."""

from dataclasses import dataclass, field

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.core.types import Array
from companion.flight.tick import Tick
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import FlightState, Phase
from mock_autopilot.faults.catalogue import Kind, Part
from mock_autopilot.physics.truth import Truth
from mock_autopilot.px4.estimator import REGAIN_AFTER_S
from mock_autopilot.px4.vocabulary import Mode
from mock_autopilot.world import World

Box = tuple[tuple[float, float], tuple[float, float], float]
"""x, y (least, largest) and top of the fence, W, m."""


def fence_of(config: CompanionConfig) -> Box:
    """The configuration's."""
    return config.fence.x_m, config.fence.y_m, config.fence.top_m


@dataclass
class Flown:
    """Observations of a flight at the mock; times by one clock, s."""

    begin_s: float | None = None
    """When the fault began."""
    armed_s: float | None = None
    lifted_s: float | None = None
    disarmed_s: float | None = None
    disarmed_in_the_air: bool = False
    beyond_m: float = -1e9
    """Furthest outside of the fence since it was armed; negative: always inside, and so near."""
    on_ground: bool = True
    armed: bool = False
    hung: bool = False
    """The autopilot hangs, so that it can neither disarm nor be disarmed."""
    touchdown_mps: float = 0.0
    """Fastest meeting with the ground, downward."""
    blinded: bool = False
    """For a while in the air PX4 had no pose."""
    drift_m: float | None = None
    """Horizontal way from where OFFBOARD ended in the air to where it stands; None where it never did."""
    modes: list[tuple[float, str]] = field(default_factory=list)
    """Every mode and when it began."""
    setpoints_s: list[float] = field(default_factory=list)

    @property
    def piloted(self) -> bool:
        """Return whether a pilot flies it at last: in Position, or in Altitude, PX4's fallback without a position."""
        names = [name for _, name in self.modes]
        return self.armed and "POSITION" in names and names[-1] in {"POSITION", "ALTITUDE"}


class Watch:
    """Observer of a World's steps and faults."""

    def __init__(self, world: World, fence: Box, zero_s: float = 0.0) -> None:
        self._world, self._zero_s = world, zero_s
        (self._x0, self._x1), (self._y0, self._y1), self._top = fence
        self.flown = Flown()
        self._setpoint_s = -1.0
        self._mode: Mode | None = None
        self._sinking_mps = 0.0
        self._left_ned_m: Array | None = None
        world.observers.append(self._step)

    def begin(self) -> None:
        """The fault begins now, if none did before."""
        if self.flown.begin_s is None:
            self.flown.begin_s = self._zero_s + self._world.time_s

    def _step(self, truth: Truth) -> None:
        vehicle, flown, now_s = self._world.vehicle, self.flown, self._zero_s + truth.time_s
        if vehicle._setpoint_at_s > self._setpoint_s:
            self._setpoint_s = vehicle._setpoint_at_s
            flown.setpoints_s.append(now_s)
        if vehicle.mode is not self._mode:
            self._mode = vehicle.mode
            flown.modes.append((now_s, self._mode.name))
        if truth.on_ground and not flown.on_ground:
            flown.touchdown_mps = max(flown.touchdown_mps, self._sinking_mps)
        flown.blinded = flown.blinded or (not truth.on_ground and vehicle.estimator.silence_s > REGAIN_AFTER_S)
        self._sinking_mps = float(truth.velocity_ned_mps[2])
        flown.on_ground = truth.on_ground
        flown.hung = any(held.fault.kind is Kind.STUCK for held in self._world.faults.active(Part.AUTOPILOT))
        self._look_at_arming(vehicle.armed, now_s)
        if flown.armed_s is None:
            return
        if flown.lifted_s is None and not truth.on_ground:
            flown.lifted_s = now_s
        north, east, down = truth.position_ned_m.tolist()
        x, y, z = north, -east, -down
        self._look_at_drift(truth)
        flown.beyond_m = max(flown.beyond_m, self._x0 - x, x - self._x1, self._y0 - y, y - self._y1, z - self._top)

    def _look_at_drift(self, truth: Truth) -> None:
        if self._mode is Mode.OFFBOARD:
            self._left_ned_m = None
            return
        if self._left_ned_m is None:
            self._left_ned_m = truth.position_ned_m.copy()
        self.flown.drift_m = float(np.linalg.norm((truth.position_ned_m - self._left_ned_m)[:2]))

    def _look_at_arming(self, armed: bool, now_s: float) -> None:
        flown = self.flown
        if armed and flown.armed_s is None:
            flown.armed_s = now_s
        if flown.armed and not armed and flown.disarmed_s is None:
            flown.disarmed_s, flown.disarmed_in_the_air = now_s, not flown.on_ground
        flown.armed = armed


@dataclass(frozen=True)
class Said:
    """One change of the companion's mind."""

    time_s: float
    phase: Phase
    level: FailsafeAction
    cause: Fault | None
    reason: str


class Told:
    """Record of what the companion says and which faults it finds; a TickSink."""

    def __init__(self) -> None:
        self.changes: list[Said] = []
        self.events: list[tuple[float, Fault]] = []
        """When each fault was there that was not there in the cycle before."""
        self._before: frozenset[Fault] = frozenset()

    def __call__(self, tick: Tick) -> None:
        """Take one tick."""
        self.take(tick.time_s, tick.flight, frozenset(event.fault for event in tick.events))

    def take(self, time_s: float, flight: FlightState, faults: frozenset[Fault]) -> None:
        """Record the flight's state if it has changed, and the faults that are new at this time."""
        said = Said(time_s, flight.phase, flight.level, flight.cause, flight.reason)
        last = self.changes[-1] if self.changes else None
        if last is None or (last.phase, last.level, last.cause) != (said.phase, said.level, said.cause):
            self.changes.append(said)
        self.events += [(time_s, fault) for fault in faults - self._before]
        self._before = faults
