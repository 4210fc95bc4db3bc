"""A flight in virtual time: the code that flies, against the mock's plant, without sockets and without sleeping.

Broadcasts over leading axes: positions (3,) are one vehicle, (B, 3) a batch.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from companion.control import frames
from companion.control.attitude import ThrustModel, accel_of_setpoint, setpoint_of_accel
from companion.control.controller import ControlInput, Controller, ControlOutput
from companion.control.limits import Limits, gate
from companion.control.reference import Trajectory
from companion.estimation import kalman
from companion.types import Array, AttitudeThrust, Reference
from mock_autopilot import plant as airframe


@dataclass(frozen=True)
class VirtualRoom:
    """What the simulated room and vehicle do to the controller."""

    plant: airframe.PlantParams = field(default_factory=airframe.PlantParams)
    mocap_age_s: float = 0.01
    setpoint_delay_s: float = 0.04
    thrust_delay_s: float = 0.008
    position_noise_m: float = 0.0003
    jerk_density: float = 4.0
    attitude_noise_rad: float = 0.002
    rate_noise_radps: float = 0.05
    disturbance_constant_n: tuple[float, float, float] = (0.4, 0.3, 0.0)
    disturbance_amplitude_n: tuple[float, float, float] = (1.4, 1.1, 0.8)
    disturbance_period_s: tuple[float, float, float] = (9.0, 13.0, 7.0)
    seed: int = 0

    def disturbance_w_n(self, time_s: float) -> Array:
        """Slow force from outside (N) in W, shape (3,)."""
        angle = 2.0 * np.pi * time_s / np.asarray(self.disturbance_period_s) + np.array([0.0, 1.0, 2.0])
        swell = np.asarray(self.disturbance_amplitude_n) * np.sin(angle)
        return np.asarray(self.disturbance_constant_n + swell)


@dataclass(frozen=True)
class Sample:
    """One control cycle of a virtual flight."""

    time_s: float
    position_w_m: Array
    velocity_w_mps: Array
    reference: Reference
    output: ControlOutput
    setpoint: AttitudeThrust
    disturbance_w_n: Array


@dataclass
class _Delayed:
    """Values that become known only some time after they were true."""

    delay_s: float
    queue: list[tuple[float, tuple[Array, ...]]] = field(default_factory=list)

    def put(self, time_s: float, *value: Array) -> None:
        self.queue.append((time_s + self.delay_s, value))

    def at(self, time_s: float) -> tuple[Array, ...]:
        while len(self.queue) > 1 and self.queue[1][0] <= time_s + 1e-9:
            self.queue.pop(0)
        return self.queue[0][1]


def fly(
    controller: Controller,
    trajectory: Trajectory,
    room: VirtualRoom,
    *,
    limits: Limits = Limits(),  # noqa: B008 - frozen
    model: ThrustModel = ThrustModel(),  # noqa: B008 - frozen
    lead: tuple[int, ...] = (),
    settle_s: float = 4.0,
    period_s: float = 0.01,
    offset_w_m: Array | None = None,
) -> Iterator[Sample]:
    """Hold the trajectory's start for `settle_s`, then fly it; one sample a control cycle, time 0 at its start.

    Begins in the air, level, at the start plus `offset_w_m`.
    """
    rng = np.random.default_rng(room.seed)
    start = np.broadcast_to(trajectory.at(0.0).position_w_m + (0 if offset_w_m is None else offset_w_m), (*lead, 3))
    truth = airframe.at_rest(frames.flip_yz(start))
    hover = AttitudeThrust(np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)), np.full(lead, model.hover_thrust))
    truth = _hovering(truth, room)
    seen = _Delayed(room.mocap_age_s)
    attitude, thrust = _Delayed(room.setpoint_delay_s), _Delayed(room.thrust_delay_s)
    last, memory = hover, None
    attitude.put(-1.0 - settle_s, hover.q_w_flu_wxyz)
    thrust.put(-1.0 - settle_s, hover.thrust)
    motion = kalman.Motion(start, 0.0 * start, 0.0 * start, kalman.Covariance(1e-6, 0.0, 0.0, 1.0, 0.0, 1.0))
    inner = 5
    for cycle in range(round((settle_s + trajectory.duration_s) / period_s)):
        time = cycle * period_s - settle_s
        position, q, rate = _measure(truth, room, rng)
        motion = kalman.predict(motion, period_s, room.jerk_density)
        motion = kalman.update(motion, position, room.position_noise_m**2 + 1e-10)
        seen.put(time, motion.position, motion.velocity, q, rate)
        position, velocity, q, rate = seen.at(time)
        reference = trajectory.at(time + controller.preview_s)
        now = ControlInput(
            position, velocity, q, rate, room.mocap_age_s, reference, accel_of_setpoint(last, model), period_s
        )
        memory = controller.initial(now) if memory is None else memory
        memory, output = controller.step(memory, now)
        wanted = setpoint_of_accel(output.accel_w_mps2, reference.yaw_rad, model)
        last = gate(wanted, last, limits, period_s).setpoint
        attitude.put(time, last.q_w_flu_wxyz)
        thrust.put(time, last.thrust)
        push = room.disturbance_w_n(time)
        yield Sample(
            time,
            frames.flip_yz(truth.position_ned_m),
            frames.flip_yz(truth.velocity_ned_mps),
            trajectory.at(time),
            output,
            last,
            push,
        )
        wrench = airframe.Wrench(frames.flip_yz(np.broadcast_to(push, (*lead, 3))), np.zeros((*lead, 3)))
        for part in range(inner):
            instant = time + part * period_s / inner
            actuation = airframe.Actuation(frames.flip_quat(attitude.at(instant)[0]), thrust.at(instant)[0])
            truth = airframe.step(truth, actuation, wrench, room.plant, period_s / inner)


def _hovering(truth: airframe.PlantState, room: VirtualRoom) -> airframe.PlantState:
    weight = np.full_like(truth.thrust_n, room.plant.mass_kg * airframe.GRAVITY_MPS2)
    return replace(truth, thrust_n=weight, on_ground=np.zeros_like(truth.on_ground))


def _measure(truth: airframe.PlantState, room: VirtualRoom, rng: np.random.Generator) -> tuple[Array, ...]:
    position = frames.flip_yz(truth.position_ned_m)
    shape = position.shape
    tilt = frames.quat_from_rotation_vector(rng.normal(0.0, room.attitude_noise_rad, shape))
    q = frames.quat_multiply(frames.flip_quat(truth.q_ned_frd_wxyz), tilt)
    return (
        position + rng.normal(0.0, room.position_noise_m, shape),
        q,
        frames.flip_yz(truth.rate_frd_radps) + rng.normal(0.0, room.rate_noise_radps, shape),
    )
