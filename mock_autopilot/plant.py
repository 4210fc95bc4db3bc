"""The physics of the simulated multirotor: a point mass that can only push along its own z axis.

Frames are the autopilot's: world NED (m), body FRD, quaternions w x y z turning body into world.
Everything broadcasts over leading axes, so one vehicle is shape (3,) and a sweep is (B, 3).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mock_autopilot import quaternion as quat
from mock_autopilot.quaternion import Array

GRAVITY_MPS2 = 9.80665
"""Standard gravity, the value PX4 uses (CONSTANTS_ONE_G)."""

ROLL, PITCH, YAW = 0, 1, 2


@dataclass(frozen=True)
class PlantParams:
    """What the vehicle is made of. Defaults fit the recorded PX4 step responses (docs/px4-conformance.md)."""

    mass_kg: float = 4.85
    """The paper's total mass m_t."""
    max_thrust_n: float = 2.0 * 4.85 * GRAVITY_MPS2
    """All rotors at full signal; twice the weight makes it hover at 0.5 as the recorded PX4 does."""
    motor_curve: float = 0.0
    """Share of the signal that acts quadratically: thrust = c s^2 + (1 - c) s."""
    thrust_lag_s: float = 0.05
    """First-order lag of the rotors (SIH_T_TAU)."""
    attitude_bandwidth_radps: tuple[float, float, float] = (7.1, 7.3, 2.7)
    """Natural frequency of the closed attitude loop about body x, y, z."""
    attitude_damping: tuple[float, float, float] = (0.92, 0.92, 0.54)
    """Damping ratio of the same."""
    torque_lag_s: tuple[float, float, float] = (0.05, 0.05, 0.13)
    """First-order lag of the torques: the rotors', and for yaw PX4's filter (MC_YAW_TQ_CUTOFF, 2 Hz) on top."""
    viscous_npm: tuple[float, float, float] = (0.6, 0.6, 0.9)
    """Friction proportional to velocity, N per m/s, world axes."""
    quadratic_npm2: tuple[float, float, float] = (0.3, 0.3, 0.4)
    """Friction proportional to the speed times the velocity, N per (m/s)^2."""
    coulomb_n: tuple[float, float, float] = (0.4, 0.4, 0.4)
    """Dry friction (N), as of a tether or cable drum: opposite to the motion whatever its speed."""
    coulomb_width_mps: float = 0.02
    """Speed over which the dry friction changes sign (tanh), so that the integration stays honest."""
    ground_z_m: float = 0.0
    """Height of the floor, NED: the vehicle stands when its z reaches this."""


@dataclass(frozen=True)
class PlantState:
    """Truth at one instant; shapes (..., 3) and (..., 4), thrust (...,)."""

    position_ned_m: Array
    velocity_ned_mps: Array
    q_ned_frd_wxyz: Array
    rate_frd_radps: Array
    thrust_n: Array
    acceleration_ned_mps2: Array
    on_ground: NDArray[np.bool_]
    turn_frd_radps2: Array
    """Angular acceleration that the lagging rotors produce."""


@dataclass(frozen=True)
class Actuation:
    """What the autopilot's loops ask of the airframe; `signal` is the motor signal 0..1."""

    q_sp_wxyz: Array
    signal: Array
    rate_sp_frd_radps: Array | None = None
    """Set in rate control: the attitude setpoint is then ignored."""
    motors_on: bool = True


@dataclass(frozen=True)
class Wrench:
    """Force from outside (N, world NED) and a push on the attitude (rad/s^2, body FRD)."""

    force_ned_n: Array
    angular_frd_radps2: Array


def at_rest(position_ned_m: Array, yaw_rad: float = 0.0) -> PlantState:
    """Standing level on the ground (or anywhere), motors off; `position_ned_m` has shape (..., 3)."""
    position = np.asarray(position_ned_m, dtype=float)
    lead = position.shape[:-1]
    zero = np.zeros_like(position)
    q = np.broadcast_to(quat.from_euler(0.0, 0.0, yaw_rad), (*lead, 4)).copy()
    standing = np.ones(lead, dtype=bool)
    return PlantState(position, zero, q, zero.copy(), np.zeros(lead), zero.copy(), standing, zero.copy())


def no_wrench(shape: tuple[int, ...] = (3,)) -> Wrench:
    """Nothing pushes."""
    return Wrench(np.zeros(shape), np.zeros(shape))


def thrust_of_signal(signal: Array, params: PlantParams) -> Array:
    """Steady thrust (N) of a motor signal 0..1, clipped to it; NaN gives none, as on the recorded PX4."""
    s = np.fmax(np.fmin(np.asarray(signal, dtype=float), 1.0), 0.0)
    s = np.where(np.isnan(signal), 0.0, s)
    c = params.motor_curve
    return np.asarray(params.max_thrust_n * (c * s * s + (1.0 - c) * s))


def friction_ned_n(velocity_ned_mps: Array, params: PlantParams) -> Array:
    """Force (N) with which air and cables oppose the motion: viscous, quadratic and Coulomb, shape (..., 3)."""
    v = velocity_ned_mps
    speed = np.sqrt((v * v).sum(axis=-1, keepdims=True))
    drag = np.asarray(params.viscous_npm) * v + np.asarray(params.quadratic_npm2) * speed * v
    return np.asarray(-drag - np.asarray(params.coulomb_n) * np.tanh(v / params.coulomb_width_mps))


def step(state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float) -> PlantState:
    """Advance the truth by `dt_s` (semi-implicit Euler; meant for 500 Hz or more)."""
    thrust = _thrust_step(state, actuation, params, dt_s)
    q, rate, turn = _attitude_step(state, actuation, wrench, params, dt_s)
    push = wrench.force_ned_n + friction_ned_n(state.velocity_ned_mps, params) - thrust[..., None] * quat.down_axis(q)
    acceleration = push / params.mass_kg + np.array([0.0, 0.0, GRAVITY_MPS2])
    velocity = state.velocity_ned_mps + acceleration * dt_s
    position = state.position_ned_m + velocity * dt_s
    airborne = np.zeros_like(state.on_ground)
    moved = PlantState(position, velocity, q, rate, thrust, acceleration, airborne, turn)
    return _rest_on_ground(moved, state, params)


def _thrust_step(state: PlantState, actuation: Actuation, params: PlantParams, dt_s: float) -> Array:
    wanted = thrust_of_signal(actuation.signal, params) if actuation.motors_on else np.zeros_like(state.thrust_n)
    return np.asarray(state.thrust_n + (wanted - state.thrust_n) * (1.0 - np.exp(-dt_s / params.thrust_lag_s)))


def _attitude_step(
    state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float
) -> tuple[Array, Array, Array]:
    """Second-order response of the attitude about each body axis, through the lag of the torques."""
    rate = state.rate_frd_radps
    lag_s = np.asarray(params.torque_lag_s)
    turn = state.turn_frd_radps2 + (_wanted_turn(state, actuation, params) - state.turn_frd_radps2) * (
        1.0 - np.exp(-dt_s / lag_s)
    )
    rate = rate + (turn + wrench.angular_frd_radps2) * dt_s
    q = quat.normalise(quat.multiply(state.q_ned_frd_wxyz, quat.from_rotation_vector(rate * dt_s)))
    return q, rate, turn


def _wanted_turn(state: PlantState, actuation: Actuation, params: PlantParams) -> Array:
    """Angular acceleration the loops ask for; without motors nothing turns the vehicle."""
    rate = state.rate_frd_radps
    if not actuation.motors_on:
        return np.zeros_like(rate)
    wn = np.asarray(params.attitude_bandwidth_radps)
    damping = 2.0 * np.asarray(params.attitude_damping) * wn
    if actuation.rate_sp_frd_radps is not None:
        return np.asarray(damping * (actuation.rate_sp_frd_radps - rate))
    error = quat.to_rotation_vector(quat.multiply(quat.conjugate(state.q_ned_frd_wxyz), actuation.q_sp_wxyz))
    return np.asarray(wn * wn * error - damping * rate)


def _rest_on_ground(moved: PlantState, before: PlantState, params: PlantParams) -> PlantState:
    """Where the floor is reached the vehicle stands still and level until it is lifted off."""
    touching = (moved.position_ned_m[..., 2] >= params.ground_z_m) & (moved.velocity_ned_mps[..., 2] >= 0.0)
    if not np.any(touching):
        return moved
    where = touching[..., None]
    floor = np.concatenate(
        (before.position_ned_m[..., :2], np.full_like(before.position_ned_m[..., 2:], params.ground_z_m)), axis=-1
    )
    zero = np.zeros_like(moved.velocity_ned_mps)
    return replace(
        moved,
        position_ned_m=np.where(where, floor, moved.position_ned_m),
        velocity_ned_mps=np.where(where, zero, moved.velocity_ned_mps),
        acceleration_ned_mps2=np.where(where, zero, moved.acceleration_ned_mps2),
        q_ned_frd_wxyz=np.where(where, _level(moved.q_ned_frd_wxyz), moved.q_ned_frd_wxyz),
        rate_frd_radps=np.where(where, zero, moved.rate_frd_radps),
        turn_frd_radps2=np.where(where, zero, moved.turn_frd_radps2),
        on_ground=touching,
    )


def _level(q: Array) -> Array:
    """The same heading without roll and pitch: the legs stand flat."""
    w, z = q[..., 0], q[..., 3]
    level = np.stack((w, np.zeros_like(w), np.zeros_like(w), z), axis=-1)
    length = np.sqrt((level * level).sum(axis=-1, keepdims=True))
    return np.where(length > 1e-9, level / np.maximum(length, 1e-9), np.array([1.0, 0.0, 0.0, 0.0]))
