"""The physics of the simulated multirotor: a point mass that can only push along its own z axis.

Frames are the autopilot's: world NED (m), body FRD, quaternions w x y z turning body into world.
Everything broadcasts over leading axes, so one vehicle is shape (3,) and a sweep is (B, 3).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.quaternion import Array

if TYPE_CHECKING:
    Each = float | Array
    EachAxis = tuple[float, float, float] | Array
else:  # what a configuration file may hold: one vehicle's numbers
    Each = float
    EachAxis = tuple[float, float, float]

GRAVITY_MPS2 = 9.80665
"""Standard gravity, the value PX4 uses (CONSTANTS_ONE_G)."""


@dataclass(frozen=True, kw_only=True)
class PlantParams:
    """The vehicle's parameters. Its attitude loop fits the recorded PX4 step responses (docs/px4-conformance.md).

    Mass and drag are the paper's vehicle's. The recorded simulator's are 1 kg, 20 N and 1 N per m/s, nothing else.

    A batch may have a number for each vehicle, shape (...,), and where three axes are meant (..., 3); such arrays are
    not to be changed afterwards.
    """

    mass_kg: Each = 4.85
    """The paper's total mass m_t."""
    max_thrust_n: Each = 2.0 * 4.85 * GRAVITY_MPS2
    """All rotors at full signal; twice the weight makes it hover at 0.5 as the recorded PX4 does."""
    motor_curve: Each = 0.0
    """Share of the signal that acts quadratically: thrust = c s^2 + (1 - c) s."""
    thrust_lag_s: Each = 0.05
    """First-order lag of the rotors (SIH_T_TAU); 0 for none."""
    attitude_bandwidth_radps: EachAxis = (7.1, 7.3, 2.7)
    """Natural frequency of the closed attitude loop about body x, y, z."""
    attitude_damping: EachAxis = (0.92, 0.92, 0.54)
    """Damping ratio of the same."""
    torque_lag_s: EachAxis = (0.05, 0.05, 0.13)
    """First-order lag of the torques: the rotors', for yaw PX4's filter (MC_YAW_TQ_CUTOFF, 2 Hz) on top. 0: none."""
    viscous_npm: EachAxis = (0.6, 0.6, 0.9)
    """Friction proportional to velocity, N per m/s, world axes."""
    quadratic_npm2: EachAxis = (0.3, 0.3, 0.4)
    """Friction proportional to the speed times the velocity, N per (m/s)^2."""
    coulomb_n: EachAxis = (0.4, 0.4, 0.4)
    """Dry friction (N), as of a tether or cable drum: opposite to the motion whatever its speed."""
    coulomb_width_mps: float = 0.02
    """Speed over which the dry friction changes sign (tanh), so that the integration stays honest."""
    ground_z_m: float = 0.0
    """Height of the floor, NED: the vehicle stands when its z reaches this."""

    @cached_property
    def _by_step(self) -> "dict[tuple[float, tuple[int, ...]], Coefficients]":
        return {}

    def coefficients(self, dt_s: float, shape: tuple[int, ...]) -> "Coefficients":
        """Return the equations' coefficients for steps of `dt_s` and velocities of shape (..., 3)."""
        known = self._by_step.get((dt_s, shape))
        if known is None:
            known = self._by_step[dt_s, shape] = _coefficients(self, dt_s, shape)
        return known


@dataclass(frozen=True, eq=False, kw_only=True)
class Coefficients:
    """The factors of a step that depend on parameters and length alone; (..., 3), as broadcasting costs time."""

    stiffness: Array
    damping: Array
    torque_gain: Array
    torque_mean: Array
    viscous: Array
    quadratic: Array
    coulomb: Array
    dry_per_mps: float
    per_kg: Array
    gravity: Array
    thrust_gain: Array
    """(...,), as its mean."""
    thrust_mean: Array


def _coefficients(params: PlantParams, dt_s: float, shape: tuple[int, ...]) -> Coefficients:
    def full(values: EachAxis) -> Array:
        return np.broadcast_to(np.asarray(values, dtype=float), shape).copy()

    wn, torque_lag_s = full(params.attitude_bandwidth_radps), full(params.torque_lag_s)
    mass_kg = full(np.asarray(params.mass_kg)[..., None])
    thrust_lag_s = np.broadcast_to(np.asarray(params.thrust_lag_s, dtype=float), shape[:-1])
    torque_gain, torque_mean = _lag(torque_lag_s, dt_s)
    thrust_gain, thrust_mean = _lag(thrust_lag_s, dt_s)
    return Coefficients(
        stiffness=wn * wn,
        damping=2.0 * full(params.attitude_damping) * wn,
        torque_gain=torque_gain,
        torque_mean=torque_mean,
        viscous=full(params.viscous_npm),
        quadratic=full(params.quadratic_npm2),
        coulomb=full(params.coulomb_n),
        dry_per_mps=1.0 / params.coulomb_width_mps,
        per_kg=1.0 / mass_kg,
        gravity=full((0.0, 0.0, GRAVITY_MPS2)),
        thrust_gain=thrust_gain,
        thrust_mean=thrust_mean,
    )


def _lag(lag_s: Array, dt_s: float) -> tuple[Array, Array]:
    """Return the share that a first-order lag covers by the end of a step, and on the step's average."""
    instant = lag_s == 0.0
    safe_s = np.where(instant, 1.0, lag_s)
    gain = -np.expm1(-dt_s / safe_s)
    return np.where(instant, 1.0, gain), np.where(instant, 1.0, 1.0 - gain * safe_s / dt_s)


@dataclass(frozen=True, kw_only=True)
class PlantState:
    """The true state at one instant; shapes (..., 3) and (..., 4), thrust (...,)."""

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
    """The setpoints of the autopilot's loops for the airframe; `signal` is the motor signal 0..1."""

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
    """Return the state of a level vehicle at rest, motors off; `position_ned_m` has shape (..., 3)."""
    position = np.asarray(position_ned_m, dtype=float)
    lead = position.shape[:-1]
    zero = np.zeros_like(position)
    q = np.broadcast_to(quat.from_euler(0.0, 0.0, yaw_rad), (*lead, 4)).copy()
    standing = np.ones(lead, dtype=bool)
    return PlantState(
        position_ned_m=position,
        velocity_ned_mps=zero,
        q_ned_frd_wxyz=q,
        rate_frd_radps=zero.copy(),
        thrust_n=np.zeros(lead),
        acceleration_ned_mps2=zero.copy(),
        on_ground=standing,
        turn_frd_radps2=zero.copy(),
    )


def no_wrench(shape: tuple[int, ...] = (3,)) -> Wrench:
    """Return a wrench of zero force and angular acceleration."""
    return Wrench(np.zeros(shape), np.zeros(shape))


def thrust_of_signal(signal: Array, params: PlantParams) -> Array:
    """Return the steady thrust (N) of a motor signal, clipped to 0..1, (...,); 0 for NaN, as on the recorded PX4."""
    s = np.fmin(np.fmax(signal, 0.0), 1.0)
    return np.asarray(params.max_thrust_n * s * (1.0 - params.motor_curve * (1.0 - s)))


def friction_ned_n(velocity_ned_mps: Array, fixed: Coefficients) -> Array:
    """Return the friction of air and cables (N), (..., 3): viscous, quadratic and Coulomb."""
    v = velocity_ned_mps
    drag = (fixed.quadratic * quat.length(v) + fixed.viscous) * v
    return np.asarray(-drag - fixed.coulomb * np.tanh(v * fixed.dry_per_mps))


def step(state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float) -> PlantState:
    """Advance the truth by `dt_s` (5 ms or less).

    Second order in the step but for the friction and the push, which are those of its beginning: lags are exact for a
    setpoint that stays, the loops ask for what the middle of the step needs, position and attitude move at the mean of
    the velocities before and after.
    """
    fixed = params.coefficients(dt_s, state.velocity_ned_mps.shape)
    thrust, mean_thrust = _thrust_step(state, actuation, params, fixed)
    q, rate, turn = _attitude_step(state, actuation, wrench, fixed, dt_s)
    lift = mean_thrust[..., None] * quat.down_axis(quat.unit(state.q_ned_frd_wxyz + q))
    push = wrench.force_ned_n + friction_ned_n(state.velocity_ned_mps, fixed) - lift
    acceleration = push * fixed.per_kg + fixed.gravity
    velocity = state.velocity_ned_mps + acceleration * dt_s
    position = state.position_ned_m + (state.velocity_ned_mps + velocity) * (0.5 * dt_s)
    touching = (position[..., 2] >= params.ground_z_m) & (velocity[..., 2] >= 0.0)
    moved = PlantState(
        position_ned_m=position,
        velocity_ned_mps=velocity,
        q_ned_frd_wxyz=q,
        rate_frd_radps=rate,
        thrust_n=thrust,
        acceleration_ned_mps2=acceleration,
        on_ground=touching,
        turn_frd_radps2=turn,
    )
    return _rest_on_ground(moved, state, params, dt_s) if touching.any() else moved


def _thrust_step(
    state: PlantState, actuation: Actuation, params: PlantParams, fixed: Coefficients
) -> tuple[Array, Array]:
    """Return the thrust at the step's end and on its average."""
    before = state.thrust_n
    gap = (thrust_of_signal(actuation.signal, params) if actuation.motors_on else 0.0) - before
    return np.asarray(before + gap * fixed.thrust_gain), np.asarray(before + gap * fixed.thrust_mean)


def _attitude_step(
    state: PlantState, actuation: Actuation, wrench: Wrench, fixed: Coefficients, dt_s: float
) -> tuple[Array, Array, Array]:
    """Advance the attitude: a second-order response about each body axis, through the lag of the torques."""
    before, push = state.turn_frd_radps2, wrench.angular_frd_radps2
    gap = _wanted_turn(state, actuation, push, fixed, 0.5 * dt_s) - before
    rate = state.rate_frd_radps + (before + gap * fixed.torque_mean + push) * dt_s
    q = quat.turned_by_small(state.q_ned_frd_wxyz, (state.rate_frd_radps + rate) * (0.25 * dt_s))
    return q, rate, before + gap * fixed.torque_gain


def _wanted_turn(state: PlantState, actuation: Actuation, push: Array, fixed: Coefficients, later_s: float) -> Array:
    """Return the loops' angular acceleration `later_s` from now; zero without motors."""
    rate = state.rate_frd_radps
    if not actuation.motors_on:
        return np.zeros_like(rate)
    rate_then = rate + (state.turn_frd_radps2 + push) * later_s
    if actuation.rate_sp_frd_radps is not None:
        return np.asarray(fixed.damping * (actuation.rate_sp_frd_radps - rate_then))
    error = quat.to_rotation_vector(quat.multiply(quat.conjugate(state.q_ned_frd_wxyz), actuation.q_sp_wxyz))
    return np.asarray(fixed.stiffness * (error - rate * later_s) - fixed.damping * rate_then)


def _rest_on_ground(moved: PlantState, before: PlantState, params: PlantParams, dt_s: float) -> PlantState:
    """Hold vehicles that reach the floor (`moved.on_ground`) still and level until they lift off.

    The accelerometers feel the impact: what it was still moving is gone within the step.
    """
    where = moved.on_ground[..., None]
    floor = before.position_ned_m.copy()
    floor[..., 2] = params.ground_z_m
    return replace(
        moved,
        position_ned_m=np.where(where, floor, moved.position_ned_m),
        velocity_ned_mps=np.where(where, 0.0, moved.velocity_ned_mps),
        acceleration_ned_mps2=np.where(where, (0.0 - before.velocity_ned_mps) / dt_s, moved.acceleration_ned_mps2),
        q_ned_frd_wxyz=np.where(where, _level(moved.q_ned_frd_wxyz), moved.q_ned_frd_wxyz),
        rate_frd_radps=np.where(where, 0.0, moved.rate_frd_radps),
        turn_frd_radps2=np.where(where, 0.0, moved.turn_frd_radps2),
    )


def _level(q: Array) -> Array:
    """Return the attitude with the same heading, without roll and pitch."""
    w, z = q[..., 0], q[..., 3]
    level = np.stack((w, np.zeros_like(w), np.zeros_like(w), z), axis=-1)
    length = np.sqrt((level * level).sum(axis=-1, keepdims=True))
    return np.where(length > 1e-9, level / np.maximum(length, 1e-9), np.array([1.0, 0.0, 0.0, 0.0]))
