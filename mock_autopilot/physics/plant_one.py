"""The same physics as plant.step for exactly one vehicle, in plain floats: faster than numpy on 3-vectors.

The equations are plant.py's, term by term; tests/mock_autopilot/physics/test_plant.py holds the two together to
rounding. To take many steps, keep the state in floats (`OneState`, `moved`); `step` takes and returns arrays.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from mock_autopilot.physics import quaternion_one as quat
from mock_autopilot.physics.components import is_anywhere, maths, where, where_each
from mock_autopilot.physics.plant import GRAVITY_MPS2, Actuation, Coefficients, PlantParams, PlantState, Wrench
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.quaternion_one import Four, Three


class OneState(NamedTuple):
    """plant.PlantState in floats (a tuple, as it is made in a third of a dataclass's time)."""

    position_ned_m: Three
    velocity_ned_mps: Three
    q_ned_frd_wxyz: Four
    rate_frd_radps: Three
    thrust_n: float
    acceleration_ned_mps2: Three
    on_ground: bool
    turn_frd_radps2: Three


class OneActuation(NamedTuple):
    """The loops' setpoints (plant.Actuation) in floats."""

    q_sp_wxyz: Four
    signal: float
    rate_sp_frd_radps: Three | None = None
    motors_on: bool = True


@dataclass(frozen=True, kw_only=True)
class Fixed:
    """The factors of a step that depend on parameters and length alone: plant.Coefficients in floats, and the rest."""

    dt_s: float
    max_thrust_n: float
    motor_curve: float
    ground_z_m: float
    stiffness: Three
    damping: Three
    torque_gain: Three
    torque_mean: Three
    viscous: Three
    quadratic: Three
    coulomb: Three
    dry_per_mps: float
    per_kg: float
    thrust_gain: float
    thrust_mean: float


def step(state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float) -> PlantState:
    """Advance one vehicle (arrays of shape (3,)) by `dt_s`; see plant.step."""
    asked = one_actuation(
        actuation.q_sp_wxyz, float(actuation.signal), actuation.rate_sp_frd_radps, actuation.motors_on
    )
    force, push = _three(wrench.force_ned_n), _three(wrench.angular_frd_radps2)
    return in_arrays(moved(in_floats(state), asked, force, push, fixed_of(params, dt_s)))


def one_actuation(q_sp_wxyz: Array, signal: float, rate_sp_frd_radps: Array | None, motors_on: bool) -> OneActuation:
    """Convert one vehicle's setpoints, arrays of shape (4,) and (3,), to floats."""
    rate_sp = None if rate_sp_frd_radps is None else _three(rate_sp_frd_radps)
    return OneActuation(_four(q_sp_wxyz), signal, rate_sp, motors_on)


def moved(state: OneState, asked: OneActuation, force_ned_n: Three, push_frd_radps2: Three, fixed: Fixed) -> OneState:
    """Advance one vehicle by a step under a force and a push from outside; see plant.step."""
    dt_s, before_n = fixed.dt_s, state.thrust_n
    gap_n = _wanted_thrust(asked, fixed) - before_n
    thrust_n, mean_thrust_n = before_n + gap_n * fixed.thrust_gain, before_n + gap_n * fixed.thrust_mean
    q, rate, turn = _attitude(state, asked, push_frd_radps2, fixed)
    lift = _lift(mean_thrust_n, state.q_ned_frd_wxyz, q)
    (x, y, z), (ux, uy, uz) = state.position_ned_m, state.velocity_ned_mps
    ax, ay, az = acceleration = _acceleration(state.velocity_ned_mps, lift, force_ned_n, fixed)
    vx, vy, vz = velocity = ux + ax * dt_s, uy + ay * dt_s, uz + az * dt_s
    half_s = 0.5 * dt_s
    place = x + (ux + vx) * half_s, y + (uy + vy) * half_s, z + (uz + vz) * half_s
    touching = (place[2] >= fixed.ground_z_m) & (vz >= 0.0)
    flying = OneState(
        position_ned_m=place,
        velocity_ned_mps=velocity,
        q_ned_frd_wxyz=q,
        rate_frd_radps=rate,
        thrust_n=thrust_n,
        acceleration_ned_mps2=acceleration,
        on_ground=touching,
        turn_frd_radps2=turn,
    )
    if not is_anywhere(touching):
        return flying
    return cast(OneState, where_each(touching, _standing(state, thrust_n, q, flying, fixed), flying))


def in_floats(state: PlantState) -> OneState:
    """Convert one vehicle's state, arrays of shape (3,), to floats."""
    return OneState(
        position_ned_m=_three(state.position_ned_m),
        velocity_ned_mps=_three(state.velocity_ned_mps),
        q_ned_frd_wxyz=_four(state.q_ned_frd_wxyz),
        rate_frd_radps=_three(state.rate_frd_radps),
        thrust_n=float(state.thrust_n),
        acceleration_ned_mps2=_three(state.acceleration_ned_mps2),
        on_ground=bool(state.on_ground),
        turn_frd_radps2=_three(state.turn_frd_radps2),
    )


def in_arrays(state: OneState) -> PlantState:
    """Convert one vehicle's state from floats to arrays: the inverse of `in_floats`."""
    place, velocity, q, rate, thrust_n, acceleration, on_ground, turn = state
    every = np.array((*place, *velocity, *rate, *acceleration, *turn, *q))  # one array and views cost less than six
    return PlantState(
        position_ned_m=every[0:3],
        velocity_ned_mps=every[3:6],
        q_ned_frd_wxyz=every[15:19],
        rate_frd_radps=every[6:9],
        thrust_n=np.array(thrust_n),
        acceleration_ned_mps2=every[9:12],
        on_ground=_STANDING if on_ground else _IN_AIR,
        turn_frd_radps2=every[12:15],
    )


def fixed_of(params: PlantParams, dt_s: float) -> Fixed:
    """Return the factors for steps of `dt_s`, cached for each set of parameters."""
    known, full_n, curve = params.coefficients(dt_s, (3,)), float(params.max_thrust_n), float(params.motor_curve)
    return _fixed(known, dt_s, full_n, curve, params.ground_z_m)


@lru_cache(maxsize=256)
def _fixed(known: Coefficients, dt_s: float, max_thrust_n: float, motor_curve: float, ground_z_m: float) -> Fixed:
    return Fixed(
        dt_s=dt_s,
        max_thrust_n=max_thrust_n,
        motor_curve=motor_curve,
        ground_z_m=ground_z_m,
        stiffness=_three(known.stiffness),
        damping=_three(known.damping),
        torque_gain=_three(known.torque_gain),
        torque_mean=_three(known.torque_mean),
        viscous=_three(known.viscous),
        quadratic=_three(known.quadratic),
        coulomb=_three(known.coulomb),
        dry_per_mps=known.dry_per_mps,
        per_kg=float(known.per_kg[0]),
        thrust_gain=float(known.thrust_gain),
        thrust_mean=float(known.thrust_mean),
    )


def _three(values: Array) -> Three:
    x, y, z = values.tolist()
    return x, y, z


def _four(values: Array) -> Four:
    w, x, y, z = values.tolist()
    return w, x, y, z


def _wanted_thrust(asked: OneActuation, fixed: Fixed) -> float:
    if not asked.motors_on:
        return 0.0
    s = where(asked.signal > 0.0, asked.signal, 0.0)  # NaN, too
    s = where(s < 1.0, s, 1.0)
    return cast(float, fixed.max_thrust_n * s * (1.0 - fixed.motor_curve * (1.0 - s)))


def _attitude(state: OneState, asked: OneActuation, push: Three, fixed: Fixed) -> tuple[Four, Three, Three]:
    p, r, y = rate = state.rate_frd_radps
    tp, tr, ty = state.turn_frd_radps2
    up, ur, uy = push
    dt_s, q = fixed.dt_s, state.q_ned_frd_wxyz
    half_s = 0.5 * dt_s
    later = (p + (tp + up) * half_s, r + (tr + ur) * half_s, y + (ty + uy) * half_s)
    wp, wr, wy = _wanted_turn(q, rate, later, asked, fixed, half_s)
    gp, gr, gy = wp - tp, wr - tr, wy - ty
    mp, mr, my = fixed.torque_mean
    p1, r1, y1 = p + (tp + gp * mp + up) * dt_s, r + (tr + gr * mr + ur) * dt_s, y + (ty + gy * my + uy) * dt_s
    quarter_s = 0.5 * half_s
    hx, hy, hz = (p + p1) * quarter_s, (r + r1) * quarter_s, (y + y1) * quarter_s
    square = hx * hx + hy * hy + hz * hz
    tan = 1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0))
    kp, kr, ky = fixed.torque_gain
    turned = quat.multiply(q, (1.0, hx * tan, hy * tan, hz * tan))
    return quat.unit(turned), (p1, r1, y1), (tp + gp * kp, tr + gr * kr, ty + gy * ky)


def _wanted_turn(q: Four, rate: Three, later: Three, asked: OneActuation, fixed: Fixed, later_s: float) -> Three:
    """Return the loops' angular acceleration; `rate` is the present one, `later` the one in `later_s`."""
    if not asked.motors_on:
        return (0.0, 0.0, 0.0)
    dx, dy, dz = fixed.damping
    p, r, y = later
    if asked.rate_sp_frd_radps is not None:
        sp, sr, sy = asked.rate_sp_frd_radps
        return dx * (sp - p), dy * (sr - r), dz * (sy - y)
    qw, qx, qy, qz = q
    ex, ey, ez = quat.to_rotation_vector(quat.multiply((qw, -qx, -qy, -qz), asked.q_sp_wxyz))
    kx, ky, kz = fixed.stiffness
    return (
        kx * (ex - rate[0] * later_s) - dx * p,
        ky * (ey - rate[1] * later_s) - dy * r,
        kz * (ez - rate[2] * later_s) - dz * y,
    )


def _lift(thrust_n: float, a: Four, b: Four) -> Three:
    """Return minus the thrust's force (N, NED) halfway between two attitudes."""
    w, x, y, z = a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]
    square = w * w + x * x + y * y + z * z
    scale = thrust_n / square
    return 2.0 * (x * z + w * y) * scale, 2.0 * (y * z - w * x) * scale, (square - 2.0 * (x * x + y * y)) * scale


def _acceleration(velocity: Three, lift: Three, push: Three, fixed: Fixed) -> Three:
    x, y, z = velocity
    m = maths(x)
    speed = m.sqrt(x * x + y * y + z * z)
    (dx, dy, dz), (ex, ey, ez), (cx, cy, cz) = fixed.viscous, fixed.quadratic, fixed.coulomb
    dry, per_kg = fixed.dry_per_mps, fixed.per_kg
    return (
        (push[0] - (ex * speed + dx) * x - cx * m.tanh(x * dry) - lift[0]) * per_kg,
        (push[1] - (ey * speed + dy) * y - cy * m.tanh(y * dry) - lift[1]) * per_kg,
        (push[2] - (ez * speed + dz) * z - cz * m.tanh(z * dry) - lift[2]) * per_kg + GRAVITY_MPS2,
    )


def _standing(before: OneState, thrust_n: float, q: Four, flying: OneState, fixed: Fixed) -> OneState:
    x, y, _ = before.position_ned_m
    w, _, _, z = q
    ux, uy, uz = before.velocity_ned_mps
    impact = ((0.0 - ux) / fixed.dt_s, (0.0 - uy) / fixed.dt_s, (0.0 - uz) / fixed.dt_s)
    length = maths(w).sqrt(w * w + z * z)
    upright, size = length > 1e-9, where(length > 1e-9, length, 1.0)
    level = (where(upright, w / size, 1.0), 0.0, 0.0, where(upright, z / size, 0.0))
    return OneState(
        position_ned_m=(x, y, fixed.ground_z_m),
        velocity_ned_mps=_STILL,
        q_ned_frd_wxyz=level,
        rate_frd_radps=_STILL,
        thrust_n=thrust_n,
        acceleration_ned_mps2=impact,
        on_ground=flying.on_ground,
        turn_frd_radps2=_STILL,
    )


_STILL = (0.0, 0.0, 0.0)
_IN_AIR = np.zeros((), dtype=bool)
_STANDING = np.ones((), dtype=bool)
