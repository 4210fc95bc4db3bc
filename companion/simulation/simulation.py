"""Flights in virtual time: estimation, law, trigger, conversion and limits as in flight, against the mock's plant.

No sockets, no sleeping. Positions (3,) are one vehicle, (B, 3) a batch; every vehicle has its own seed, and the same
seeds give the same flight to the last bit. One vehicle uses the `estimator.step` of the flight loop, a batch the same
filters without the verdicts on single frames.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from companion.control.controller import Controller
from companion.control.horizon_correction import HorizonInput, HorizonRules
from companion.control.pipeline import ControlPipeline, PipelineOutput, changed, idle_setpoint
from companion.control.wire_setpoint import WireSetpoint
from companion.core.types import Array, AttitudeThrust, MocapFrame, Reference, Scalar, VehicleState
from companion.estimation import batch, estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.geometry.attitude import ThrustModel
from companion.geometry.frames import flip_yz, matrix_from_quat, turned
from companion.guard.limits import Limits
from companion.simulation import compiled_flight
from companion.simulation.mission import Mission
from companion.simulation.virtual_ground import GroundFlight, GroundRole, HeldCommand
from companion.simulation.virtual_link_ends import Messages
from companion.simulation.virtual_world import Look, VirtualVehicle, VirtualWorld

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """Companion's side of a virtual flight: law, limits, estimator, corrections."""

    law: Controller
    thrust: ThrustModel = field(default_factory=ThrustModel)
    limits: Limits = field(default_factory=Limits)
    estimator: EstimatorParams = field(default_factory=EstimatorParams)
    period_s: float = 0.01
    feedforward_b_mps2: Array | None = None
    """Acceleration that the arms' commanded motion causes per cycle (n, 3), body frame; None: no feed-forward."""
    horizon: HorizonRules = field(default_factory=HorizonRules)
    ground: GroundRole | None = None
    """The law on the ground and its link; None: the law is on board."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Result of a virtual flight: n cycles, then the batch's leading axes. Positions are the truth."""

    time_s: Array
    """(n,), 0 where the trajectory begins."""
    position_w_m: Array
    velocity_w_mps: Array
    reference_w_m: Array
    reference_velocity_w_mps: Array
    accel_w_mps2: Array
    """u, held between events."""
    event: Mask
    sent: Mask
    """Cycles in which a setpoint was sent: at events, and while the rate limits still move towards one."""
    signals: dict[str, Array] = field(default_factory=dict)
    """Internal values of the law, each (n, ..., k); empty unless `keep_signals`."""
    messages: Messages | None = None
    """Messages of a law on the ground; None for one on board."""

    @property
    def error_w_m(self) -> Array:
        """Position less reference, (n, ..., 3)."""
        return np.asarray(self.position_w_m - self.reference_w_m)

    @property
    def flown(self) -> Mask | None:
        """Cycles (n, ...) before PX4 landed a vehicle whose ground was silent; None: all of all vehicles."""
        return None if self.messages is None or not self.messages.landed.any() else ~self.messages.landed


def simulate(
    pilot: Pilot,
    vehicle: VirtualVehicle,
    mission: Mission,
    seeds: Sequence[int],
    *,
    keep_signals: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Trace:
    """Fly a mission from a level hover; `seeds` has one entry per vehicle. `progress` is called with each cycle.

    The compiled loop flies what it can, with the same numbers; Python flies the rest, and whatever keeps its signals.
    """
    rows = None if keep_signals else compiled_flight.fly(pilot, vehicle, mission, seeds, progress)
    if rows is not None:
        return _trace_of(rows, mission)
    return simulate_in_python(pilot, vehicle, mission, seeds, keep_signals=keep_signals, progress=progress)


def _trace_of(rows: Array, mission: Mission) -> Trace:
    """Return the result of compiled flights; see `compiled_flight.fly` for the rows."""
    columns, now = rows.transpose(2, 0, 1) if mission.lead else rows[0].T, mission.now
    return Trace(
        time_s=mission.time_s,
        position_w_m=columns[..., 0:3],
        velocity_w_mps=columns[..., 3:6],
        reference_w_m=now.position_w_m,
        reference_velocity_w_mps=now.velocity_w_mps,
        accel_w_mps2=columns[..., 6:9],
        event=columns[..., 9] != 0.0,
        sent=columns[..., 10] != 0.0,
    )


def simulate_in_python(
    pilot: Pilot,
    vehicle: VirtualVehicle,
    mission: Mission,
    seeds: Sequence[int],
    *,
    keep_signals: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Trace:
    """Fly as `simulate` does, without compiled code."""
    count, lead = len(mission.time_s), mission.lead
    world = VirtualWorld(vehicle, mission.now.position_w_m[0], seeds, count, pilot.period_s)
    eyes: _Eyes = _Batch(pilot) if lead else _One(pilot)
    last = idle_setpoint(mission.now.yaw_rad[0], pilot.thrust.hover_thrust)
    flight = _flight(pilot, last, seeds, count)
    out = _Out(pilot, lead, last)
    rows = _Rows(keep_signals)
    with np.errstate(over="ignore", invalid="ignore"):  # divergence is a result
        for cycle in range(count):
            look = world.look()
            seen, age_s = eyes.see(look, cycle)
            known = _turned(pilot.feedforward_b_mps2, cycle, seen.q_w_flu_wxyz)
            result, setpoint = flight.fly(cycle, seen, age_s, mission.ahead.at(cycle), last, known)
            sent = out.send(setpoint, changed(setpoint, last), look, seen, age_s)
            rows.put(world, result.law_output.accel_w_mps2, result.law_output.event, sent)
            last = setpoint
            rows.keep(result.law_output.signals, flight.settle())
            world.advance(out.wire)
            if progress is not None:
                progress(cycle)
    return replace(rows.trace(mission), messages=flight.messages())


def _flight(pilot: Pilot, first: AttitudeThrust, seeds: Sequence[int], cycles: int) -> "_OnBoard | GroundFlight":
    pipeline = ControlPipeline(pilot.law, pilot.thrust, pilot.limits, first.thrust.shape)
    role = pilot.ground
    if role is None:
        return _OnBoard(pipeline, pilot.period_s)
    vehicle = HeldCommand(first, pilot.thrust, pilot.limits, role.level)
    return GroundFlight(pipeline, vehicle, role, seeds, cycles, pilot.period_s)


class _OnBoard:
    """Law on board: its setpoint is the vehicle's."""

    def __init__(self, pipeline: ControlPipeline, period_s: float) -> None:
        self._pipeline, self._period_s = pipeline, period_s

    def fly(
        self,
        cycle: int,  # noqa: ARG002 - the law on the ground needs it
        seen: VehicleState,
        age_s: Scalar,
        ahead: Reference,
        last: AttitudeThrust,
        known_accel_w_mps2: Array,
    ) -> tuple[PipelineOutput, AttitudeThrust]:
        output = self._pipeline.fly(seen, age_s, ahead, last, self._period_s, known_accel_w_mps2)
        return output, output.limited.setpoint

    def settle(self) -> dict[str, Array]:
        return self._pipeline.settle()

    def messages(self) -> None:
        return None


def _turned(feedforward_b_mps2: Array | None, cycle: int, q_w_flu_wxyz: Array) -> Array:
    return _NOTHING if feedforward_b_mps2 is None else turned(q_w_flu_wxyz, feedforward_b_mps2[cycle])


class _Out:
    """Output stage: the setpoint on the wire, with the horizon corrected."""

    def __init__(self, pilot: Pilot, lead: tuple[int, ...], first: AttitudeThrust) -> None:
        self._corrector, self._period_s = WireSetpoint(pilot.horizon, pilot.limits, lead), pilot.period_s
        self.wire = first

    def send(
        self, setpoint: AttitudeThrust, is_new: Mask, look: Look, seen: VehicleState, age_s: float | Array
    ) -> Mask:
        """Update the setpoint on the wire with that of the law; return where it has changed, (...,)."""
        before = self.wire
        age_s = age_s[..., 0] if isinstance(age_s, np.ndarray) else age_s
        theirs_s = look.autopilot_age_s if look.autopilot_age_s.ndim else float(look.autopilot_age_s)
        horizon = HorizonInput(
            q_w_flu_wxyz=seen.q_w_flu_wxyz,
            rate_flu_radps=seen.rate_flu_radps,
            age_s=age_s,
            autopilot_q_w_flu_wxyz=look.autopilot_q_w_flu_wxyz,
            autopilot_age_s=theirs_s,
            trusted=True,
            flying=True,
        )
        self.wire = self._corrector.put(setpoint, is_new, before, horizon, self._period_s).setpoint
        return changed(self.wire, before)


class _Eyes(Protocol):
    """Estimator interface: from a frame of motion capture to the vehicle's state and its age (s)."""

    def see(self, look: Look, cycle: int) -> tuple[VehicleState, float | Array]:
        """Update with the frame of a cycle; return the state and its age (s)."""


class _One:
    """Estimator of one vehicle: the one of the flight loop, with clocks and verdicts."""

    def __init__(self, pilot: Pilot) -> None:
        self._params, self._period_s = pilot.estimator, pilot.period_s
        self._state = EstimatorState()

    def see(self, look: Look, cycle: int) -> tuple[VehicleState, float]:
        now_s = cycle * self._period_s
        if look.fresh or cycle == 0:
            frame = MocapFrame(
                frame=cycle,
                stamp_s=now_s,
                received_s=now_s,
                position_w_m=look.position_w_m,
                rotation_w_b=matrix_from_quat(look.q_w_flu_wxyz),
                residual_m=np.nan,
            )
            self._state = estimator.step(self._state, frame, self._params)
        assert self._state.vehicle is not None
        return self._state.vehicle, now_s - self._state.vehicle.time_s


class _Batch:
    """Estimator of a batch: the same filters, without clocks and verdicts."""

    def __init__(self, pilot: Pilot) -> None:
        self._params, self._period_s = pilot.estimator, pilot.period_s
        self._estimate: batch.BatchEstimate | None = None

    def see(self, look: Look, cycle: int) -> tuple[VehicleState, float | Array]:
        now_s, p, q = cycle * self._period_s, look.position_w_m, look.q_w_flu_wxyz
        if self._estimate is None:
            self._estimate = batch.begin(p, q, now_s, self._params)
        else:
            self._estimate = batch.step(self._estimate, p, q, now_s, look.fresh, self._params)
        vehicle = batch.vehicle_state(self._estimate)
        age_s = now_s - np.asarray(vehicle.time_s) + self._params.delay_s
        return vehicle, age_s[..., None] if age_s.ndim else float(age_s)


class _Rows:
    """Recorded values of each cycle."""

    def __init__(self, keep_signals: bool) -> None:
        self._moving, self._accel, self._event, self._sent = list[Any](), list[Array](), list[Array](), list[Any]()
        self._keep = keep_signals
        self._signals: dict[str, list[Array]] = {}

    def put(self, world: VirtualWorld, accel_w_mps2: Array, event: Array, sent: Mask) -> None:
        self._moving.append(world.moving_ned)
        self._accel.append(accel_w_mps2)
        self._event.append(event)
        self._sent.append(sent)

    def keep(self, *signals: dict[str, Array]) -> None:
        if self._keep:
            for some in signals:
                for name, value in some.items():
                    self._signals.setdefault(name, []).append(value)

    def trace(self, mission: Mission) -> Trace:
        now, (position_ned_m, velocity_ned_mps) = mission.now, zip(*self._moving, strict=True)
        return Trace(
            time_s=mission.time_s,
            position_w_m=flip_yz(np.array(position_ned_m)),
            velocity_w_mps=flip_yz(np.array(velocity_ned_mps)),
            reference_w_m=now.position_w_m,
            reference_velocity_w_mps=now.velocity_w_mps,
            accel_w_mps2=np.array(self._accel),
            event=np.array(self._event)[..., 0].astype(bool),
            sent=np.array(self._sent),
            signals={name: np.array(values) for name, values in self._signals.items()},
        )


_NOTHING = np.zeros(3)
