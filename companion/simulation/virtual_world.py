"""Simulated side of a virtual flight: the true vehicle, room and arms, of which the law has a model.

Everything that may differ between the vehicles of a batch is a number, or an array over the batch's leading axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array, AttitudeThrust
from companion.core.values import value
from companion.geometry.frames import flip_yz, quat_from_rotation_vector
from companion.simulation.virtual_body import Begin, Body, ManyBodies, OneBody
from mock_autopilot.physics import plant
from mock_autopilot.physics.arm_table import ArmTable
from mock_autopilot.physics.arms import Coupling
from mock_autopilot.physics.disturbance import Forces, force_series
from mock_autopilot.physics.plant import GRAVITY_MPS2, PlantParams, PlantState
from mock_autopilot.px4.attitude_error import PERFECT_HORIZON, SAMPLE_HZ, AttitudeErrorParams, AttitudeErrorSamples

STEP_S = 0.005
"""Time step of the plant; every delay is a whole number of them."""

Each = float | Array
"""One number for all vehicles, or one each, (...,)."""


@dataclass(frozen=True)
class Carried:
    """Arms during a flight: their true motion, and the vehicle's properties that it acts on."""

    table: ArmTable
    """Motion at steps of STEP_S, from the start of the flight."""
    inertia_kgm2: tuple[float, float, float] = (0.11, 0.10, 0.13)
    trim_s: tuple[float, float, float] = (0.75, 0.75, 0.75)
    """Time constants with which the autopilot trims out a lasting torque, about body x, y, z."""


@dataclass(frozen=True, kw_only=True)
class VirtualVehicle:
    """Parameters of one vehicle and its room, or of a batch."""

    plant: PlantParams = field(default_factory=PlantParams)
    mocap_delay_s: Each = 0.02
    attitude_delay_s: Each = 0.02
    """Time from sending a setpoint to its use in the attitude loop."""
    thrust_delay_s: Each = 0.02
    """Time from sending a setpoint to the motor signal."""
    noise_m: Each = 0.0003
    """Standard deviation of a measured position, per axis."""
    noise_rad: Each = 0.002
    """Standard deviation of a measured attitude, per body axis."""
    forces: Forces = field(default_factory=Forces)
    force_scale: Each = 1.0
    attitude_error: AttitudeErrorParams = PERFECT_HORIZON
    """Error of the autopilot's horizon, in which it flies and which it reports."""
    report_delay_s: Each = 0.02
    """Age of the autopilot's attitude when it arrives, waiting for the next message included."""
    arms: Carried | None = None
    offset_w_m: Array = field(default_factory=lambda: np.zeros(3))
    """Offset of the initial position from the trajectory's start, (..., 3) in W."""
    unseen: NDArray[np.bool_] | None = None
    """Cycles whose frame is lost, (n, ...); None loses none."""


@value
class Look:
    """Measurements of one cycle, and where there is a new frame, (...,); the autopilot's attitude in any case."""

    position_w_m: Array
    q_w_flu_wxyz: Array
    fresh: NDArray[np.bool_]
    autopilot_q_w_flu_wxyz: Array
    """Attitude estimate of the autopilot `autopilot_age_s` ago, (..., 4)."""
    autopilot_age_s: Array
    """Age of that estimate: () if equal for all, or (...,)."""


class VirtualWorld:
    """True state over time. Call `look` at the beginning of each control cycle and `advance` at its end."""

    def __init__(self, vehicle: VirtualVehicle, start_w_m: Array, seeds: Sequence[int], cycles: int, period_s: float):
        self._vehicle, self._lead = vehicle, start_w_m.shape[:-1]
        self._per_cycle = round(period_s / STEP_S)
        self._steps = 0
        self._all = np.ones(self._lead, dtype=bool)
        self._report_age_s = np.asarray(steps_of(vehicle.report_delay_s) * STEP_S)
        self._draw(seeds, cycles)
        self._body = self._begun(start_w_m + vehicle.offset_w_m)

    def _begun(self, start_w_m: Array) -> Body:
        v, arms = self._vehicle, self._vehicle.arms
        begin = Begin(
            params=v.plant,
            state=hovering(start_w_m, v.plant),
            signal=hover_signal(v.plant, self._lead),
            mocap_delay=steps_of(v.mocap_delay_s),
            attitude_delay=steps_of(v.attitude_delay_s),
            thrust_delay=steps_of(v.thrust_delay_s),
            report_delay=steps_of(v.report_delay_s),
            attitude_error_rad=self._attitude_error_rad,
            coupling=None
            if arms is None
            else Coupling(arms.table.at(0), v.plant.mass_kg, arms.inertia_kgm2, arms.trim_s),
            step_s=STEP_S,
        )
        return ManyBodies(begin) if self._lead else OneBody(begin)

    def _draw(self, seeds: Sequence[int], cycles: int) -> None:
        """Draw all random numbers, for each vehicle from its own seed."""
        v, steps = self._vehicle, cycles * self._per_cycle
        eyes, forces, horizons = zip(*(np.random.SeedSequence(seed).spawn(3) for seed in seeds), strict=True)
        noise = np.stack([np.random.default_rng(eye).standard_normal((cycles, 6)) for eye in eyes], axis=1)
        noise = noise.reshape(cycles, *self._lead, 6)
        self._offsets_m = noise[..., :3] * np.asarray(v.noise_m)[..., None]
        self._turns = quat_from_rotation_vector(noise[..., 3:] * np.asarray(v.noise_rad)[..., None])
        rngs = [np.random.default_rng(force) for force in forces]
        series = force_series(v.forces, rngs, STEP_S, steps).reshape(steps, *self._lead, 3)
        self.force_ned_n = series * np.asarray(v.force_scale)[..., None]
        """Force in each step (N), (steps, ..., 3), NED."""
        self._attitude_error_rad = self._horizon([np.random.default_rng(horizon) for horizon in horizons], steps)

    def _horizon(self, rngs: Sequence[np.random.Generator], steps: int) -> Array | None:
        """Return each vehicle's error of roll and pitch (rad), (samples, ..., 2); None where all are perfect."""
        if not self._vehicle.attitude_error.present:
            return None
        samples = AttitudeErrorSamples(self._vehicle.attitude_error, rngs, self._lead)
        return samples.more(int(steps * STEP_S * SAMPLE_HZ) + 3)

    @property
    def cycle(self) -> int:
        """Number of completed cycles."""
        return self._steps // self._per_cycle

    @property
    def state(self) -> PlantState:
        """True state now."""
        return self._body.state

    @property
    def moving_ned(self) -> tuple[Any, Any]:
        """True position (m) and velocity (m/s), NED: arrays (..., 3), or three floats each; cheaper than `state`."""
        return self._body.moving_ned

    def look(self) -> Look:
        """Return the measurements that arrive now."""
        cycle, unseen = self.cycle, self._vehicle.unseen
        position, q = self._body.seen(self._offsets_m[cycle], self._turns[cycle])
        fresh = self._all if unseen is None else ~unseen[cycle]
        return Look(position, q, fresh, self._body.reported(), self._report_age_s)

    def advance(self, setpoint: AttitudeThrust) -> None:
        """Advance by one control cycle with a setpoint that is sent now."""
        arms = self._vehicle.arms
        self._body.hear(setpoint)
        for _ in range(self._per_cycle):
            moving = None if arms is None else arms.table.at(self._steps)
            self._body.step(self.force_ned_n[self._steps], moving)
            self._steps += 1


def steps_of(delay_s: Each) -> NDArray[np.int64]:
    """Return a delay in whole steps of the plant."""
    return np.rint(np.asarray(delay_s) / STEP_S).astype(np.int64)


def hover_signal(params: PlantParams, lead: tuple[int, ...]) -> Array:
    """Return the motor signal that carries the weight, (...,)."""
    share = np.asarray(params.mass_kg) * GRAVITY_MPS2 / np.asarray(params.max_thrust_n)
    c = np.asarray(params.motor_curve)
    curved = (np.sqrt((1.0 - c) ** 2 + 4.0 * c * share) - (1.0 - c)) / np.where(c > 0.0, 2.0 * c, 1.0)
    return np.broadcast_to(np.where(c > 0.0, curved, share), lead)


def hovering(start_w_m: Array, params: PlantParams) -> PlantState:
    """Return the state of vehicles (...,) that hover here, level and still."""
    truth = plant.at_rest(flip_yz(start_w_m))
    weight_n = np.broadcast_to(np.asarray(params.mass_kg) * GRAVITY_MPS2, truth.thrust_n.shape)
    return replace(truth, thrust_n=np.array(weight_n), on_ground=np.zeros_like(truth.on_ground))
