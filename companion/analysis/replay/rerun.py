"""Recorded inputs through the controller again.

The estimates from the frames, and the outputs of law and guard from their recorded inputs, are computed again, each
from its recorded input, so that one difference does not hide behind another. On the ground the law sleeps: there is
nothing to compare but the estimate.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.analysis.replay.laws import LawKey, key_of
from companion.config.companion_config import CompanionConfig
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline, idle_setpoint
from companion.control.remote_law import RemoteLaw
from companion.control.wire_setpoint import WireSetpoint
from companion.core.types import Array, AttitudeThrust, VehicleState
from companion.estimation import estimator, from_autopilot
from companion.estimation.estimator import EstimatorState
from companion.flight.assembly import estimator_of, from_autopilot_of, ground_pipeline_of, pipeline_of, wire_of
from companion.records.errors import RecordError
from companion.records.read import FlightRecord, RecordedTick


@dataclass
class Difference:
    """Difference of one quantity between the replay and the record."""

    name: str
    compared: int = 0
    differ: int = 0
    """Cycles in which it is not the same to the last bit."""
    most: float = 0.0
    """Largest absolute difference of a component."""
    square_sum: float = 0.0
    first_s: float | None = None
    """Time of the first difference, from the beginning of the record."""

    @property
    def rms(self) -> float:
        """Root mean square of the difference's norm."""
        return float(np.sqrt(self.square_sum / self.compared)) if self.compared else 0.0

    def take(self, recorded: Array, again: Array, at_s: float) -> None:
        """Compare one cycle's; NaN equals NaN."""
        self.compared += 1
        if np.array_equal(recorded, again, equal_nan=True):
            return
        self.differ += 1
        self.first_s = at_s if self.first_s is None else self.first_s
        off = np.asarray(again, np.float64) - np.asarray(recorded, np.float64)
        self.most = max(self.most, float(np.abs(off).max()) if np.isfinite(off).all() else np.inf)
        self.square_sum += float(np.sum(off * off))


@dataclass(kw_only=True)
class Replayed:
    """Result of a replay: one comparison for each quantity, and the ticks replayed."""

    law: str
    """That was replayed; the record's own where empty."""
    ticks: int = 0
    flown: int = 0
    differences: dict[str, Difference] = field(default_factory=dict)
    events: tuple[int, int] = (0, 0)
    """Cycles worth sending, in the record and now."""
    time_s: list[float] = field(default_factory=list)
    """Times of the flown cycles, from the beginning of the record."""
    recorded_accel_w_mps2: list[Array] = field(default_factory=list)
    accel_w_mps2: list[Array] = field(default_factory=list)

    @property
    def identical(self) -> bool:
        """All that was compared is the same to the last bit."""
        return all(one.differ == 0 for one in self.differences.values())

    def compare(self, name: str, recorded: Array, again: Array, at_s: float) -> None:
        """Note one quantity of one cycle."""
        self.differences.setdefault(name, Difference(name)).take(recorded, again, at_s)


def replay(
    record: FlightRecord, config: CompanionConfig, laws: Mapping[LawKey, Controller], other: Controller | None = None
) -> Replayed:
    """Replay the whole record by the laws that flew it, or by another one in their place.

    RecordError for a record that is too old for it, or in which no law was in charge. Another law is given what the
    recorded one was given: it shows what that law would have wanted there, not how the vehicle would have flown.
    """
    if not record.law_flew:
        raise RecordError(f"{record.path}: the law was never in charge in this flight: nothing to compare")
    done = Replayed(law="" if other is None else "another")
    begin_s = float(record.columns["time_s"][0])
    estimating = _Estimating(record, config)
    first = other if other is not None else next(iter(laws.values()))
    pipeline = ground_pipeline_of(config, first) if record.is_of_ground else pipeline_of(config, first, record.frames)
    flying = _Flying(record.path, pipeline, laws, other)
    sending = _Sending(wire_of(config, record.frames))
    for row, tick in enumerate(record.ticks()):
        done.ticks += 1
        if row > 0 and other is None:
            estimating.step(row, tick, done, tick.time_s - begin_s)
        flying.step(tick, done, tick.time_s - begin_s)
        if other is None:
            sending.step(tick, done, tick.time_s - begin_s)
    return done


class _Estimating:
    """Replay of the estimator: frames to estimates, or without them the autopilot's motion and the ground's poses."""

    def __init__(self, record: FlightRecord, config: CompanionConfig) -> None:
        self._state: EstimatorState | None = record.first_estimate
        self._columns = record.columns
        self._params, self._without_frames = estimator_of(config), from_autopilot_of(config)

    def step(self, row: int, tick: RecordedTick, done: Replayed, at_s: float) -> None:
        if self._state is None or (tick.frame is None and tick.motion is None):
            return
        if tick.motion is not None:
            self._state = from_autopilot.step(self._state, tick.motion, tick.motion.pose, self._without_frames)
        elif tick.frame is not None:
            self._state = estimator.step(self._state, tick.frame, self._params)
        vehicle = self._state.vehicle
        if vehicle is None:
            return
        for name, again in (
            ("position_w_m", vehicle.position_w_m),
            ("velocity_w_mps", vehicle.velocity_w_mps),
            ("q_w_flu_wxyz", vehicle.q_w_flu_wxyz),
            ("rate_flu_radps", vehicle.rate_flu_radps),
        ):
            done.compare(f"estimate {name}", self._columns[name][row], again, at_s)


class _Sending:
    """Replay of the horizon correction: limited setpoints to the setpoints sent."""

    def __init__(self, wire: WireSetpoint) -> None:
        self._wire = wire

    def step(self, tick: RecordedTick, done: Replayed, at_s: float) -> None:
        wire, setpoint = tick.wire, tick.setpoint
        if wire is None or setpoint is None:
            return
        if wire.begun:
            self._wire.reset()
        last = AttitudeThrust(wire.last_q_w_flu_wxyz, setpoint.thrust)
        again = self._wire.put(setpoint, wire.is_new, last, wire.inputs, wire.dt_s)
        done.compare("sent attitude", wire.setpoint.q_w_flu_wxyz, again.setpoint.q_w_flu_wxyz, at_s)
        done.compare("sent thrust", wire.setpoint.thrust, again.setpoint.thrust, at_s)
        h = again.horizon
        done.compare("horizon", wire.error_rad, np.array([float(v) for v in (h.off_x, h.off_y, h.x, h.y)]), at_s)


class _Flying:
    """Replay of the control pipeline: the law's inputs to limited setpoints."""

    def __init__(
        self, path: Path, pipeline: ControlPipeline, laws: Mapping[LawKey, Controller], other: Controller | None
    ) -> None:
        self._path, self._pipeline = path, pipeline
        self._laws, self._other = laws, other
        self._sent = idle_setpoint(0.0)
        self._law: LawKey | None = None
        self._flight: int | None = None
        """Number of the flight in which the law flew last; None once it has ended."""

    def step(self, tick: RecordedTick, done: Replayed, at_s: float) -> None:
        given = tick.given
        if given is not None:
            self._begin(tick)
            self._hear(tick)
            vehicle = VehicleState(
                tick.time_s,
                given.position_w_m,
                given.velocity_w_mps,
                given.q_w_flu_wxyz,
                given.rate_flu_radps,
                tick.others,
            )
            known_mps2 = given.known_accel_w_mps2
            sent = self._sent if tick.mirror is None else tick.mirror
            output = self._pipeline.fly(vehicle, given.age_s, given.reference, sent, given.dt_s, known_mps2)
            late = self._pipeline.settle()
            self._compare(tick, done, at_s, output.law_output.accel_w_mps2, output.law_output.signals | late)
            if self._other is None and tick.setpoint is not None:
                again = output.limited.setpoint
                done.compare("setpoint attitude", tick.setpoint.q_w_flu_wxyz, again.q_w_flu_wxyz, at_s)
                done.compare("setpoint thrust", tick.setpoint.thrust, again.thrust, at_s)
            before, now = done.events
            done.events = before + tick.event, now + bool(output.law_output.event.any())
            done.flown += 1
            self._flight = tick.epoch
        if not tick.airborne:
            self._flight = None
        if tick.setpoint is not None:
            self._sent = tick.setpoint

    def _begin(self, tick: RecordedTick) -> None:
        """Reset the law where the flight did: without memory, or when it took over from another law."""
        if not tick.begun:
            return
        law = key_of(tick)
        switched = self._flight == tick.epoch and self._law is not None  # also to the same law, loaded again
        if self._other is None and (switched or law != self._law):
            self._pipeline.switch(self._laws[law])
        if not switched:
            self._pipeline.forget()
        self._law = law

    def _hear(self, tick: RecordedTick) -> None:
        """Give a stand-in of a law on the ground the command that it had."""
        law = self._laws.get(key_of(tick))
        if isinstance(law, RemoteLaw) and tick.command is not None:
            law.command = tick.command

    def _compare(
        self, tick: RecordedTick, done: Replayed, at_s: float, accel_w_mps2: Array, signals: Mapping[str, Array]
    ) -> None:
        assert tick.accel_w_mps2 is not None
        done.compare("command", tick.accel_w_mps2, accel_w_mps2, at_s)
        done.time_s.append(at_s)
        done.recorded_accel_w_mps2.append(tick.accel_w_mps2)
        done.accel_w_mps2.append(accel_w_mps2)
        if self._other is not None:
            return
        for name in [name for name in tick.signals if name in signals]:
            shape, again = np.shape(tick.signals[name]), np.asarray(signals[name])
            if again.size != math.prod(shape):
                raise RecordError(f"{self._path}: the law's {name} has another shape now: it was another version's law")
            done.compare(f"law {name}", tick.signals[name], again.reshape(shape), at_s)
