"""The same physics as plant.step for exactly one vehicle, in plain floats: faster than numpy on 3-vectors.

The equations are plant.py's, term by term; tests/mock_autopilot/test_plant.py holds the two together to rounding.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mock_autopilot.plant import GRAVITY_MPS2, Actuation, Coefficients, PlantParams, PlantState, Wrench
from mock_autopilot.quaternion import Array

Four = tuple[float, float, float, float]
Three = tuple[float, float, float]


@dataclass(frozen=True)
class _Plain:
    """plant.Coefficients in floats."""

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
    fixed = _plain(params.coefficients(dt_s, (3,)))
    before_n = float(state.thrust_n)
    gap_n = _wanted_thrust(actuation, params) - before_n
    thrust_n, mean_thrust_n = before_n + gap_n * fixed.thrust_gain, before_n + gap_n * fixed.thrust_mean
    q_before: Four = tuple(state.q_ned_frd_wxyz.tolist())
    q, rate, turn = _attitude(state, q_before, actuation, wrench, fixed, dt_s)
    lift = _lift(mean_thrust_n, q_before, q)
    (x, y, z), before = state.position_ned_m.tolist(), state.velocity_ned_mps.tolist()
    acceleration = _acceleration(before, lift, wrench.force_ned_n.tolist(), fixed)
    (ux, uy, uz), (ax, ay, az) = before, acceleration
    vx, vy, vz = ux + ax * dt_s, uy + ay * dt_s, uz + az * dt_s
    half_s = 0.5 * dt_s
    x, y, z = x + (ux + vx) * half_s, y + (uy + vy) * half_s, z + (uz + vz) * half_s
    if z >= params.ground_z_m and vz >= 0.0:
        return _standing(state, thrust_n, q, params)
    every = np.array((x, y, z, vx, vy, vz, *rate, ax, ay, az, *turn, *q))  # one array and views cost less than six
    return PlantState(
        every[0:3], every[3:6], every[15:19], every[6:9], np.array(thrust_n), every[9:12], _IN_AIR, every[12:15]
    )


@lru_cache(maxsize=256)
def _plain(fixed: Coefficients) -> _Plain:
    return _Plain(
        _three(fixed.stiffness),
        _three(fixed.damping),
        _three(fixed.torque_gain),
        _three(fixed.torque_mean),
        _three(fixed.viscous),
        _three(fixed.quadratic),
        _three(fixed.coulomb),
        fixed.dry_per_mps,
        float(fixed.per_kg[0]),
        float(fixed.thrust_gain),
        float(fixed.thrust_mean),
    )


def _three(values: Array) -> Three:
    x, y, z = values.tolist()
    return x, y, z


def _wanted_thrust(actuation: Actuation, params: PlantParams) -> float:
    signal = float(actuation.signal)
    if not actuation.motors_on or math.isnan(signal):
        return 0.0
    s = min(max(signal, 0.0), 1.0)
    return float(params.max_thrust_n * s * (1.0 - params.motor_curve * (1.0 - s)))


def _attitude(
    state: PlantState, q: Four, actuation: Actuation, wrench: Wrench, fixed: _Plain, dt_s: float
) -> tuple[Four, Three, Three]:
    p, r, y = rate = _three(state.rate_frd_radps)
    tp, tr, ty = _three(state.turn_frd_radps2)
    up, ur, uy = _three(wrench.angular_frd_radps2)
    half_s = 0.5 * dt_s
    later = (p + (tp + up) * half_s, r + (tr + ur) * half_s, y + (ty + uy) * half_s)
    wp, wr, wy = _wanted_turn(q, rate, later, actuation, fixed, half_s)
    gp, gr, gy = wp - tp, wr - tr, wy - ty
    mp, mr, my = fixed.torque_mean
    p1, r1, y1 = p + (tp + gp * mp + up) * dt_s, r + (tr + gr * mr + ur) * dt_s, y + (ty + gy * my + uy) * dt_s
    quarter_s = 0.5 * half_s
    hx, hy, hz = (p + p1) * quarter_s, (r + r1) * quarter_s, (y + y1) * quarter_s
    square = hx * hx + hy * hy + hz * hz
    tan = 1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0))
    kp, kr, ky = fixed.torque_gain
    turned = _multiply(q, (1.0, hx * tan, hy * tan, hz * tan))
    return _unit(turned), (p1, r1, y1), (tp + gp * kp, tr + gr * kr, ty + gy * ky)


def _wanted_turn(q: Four, rate: Three, later: Three, actuation: Actuation, fixed: _Plain, later_s: float) -> Three:
    """`rate` now, `later` what it will be in `later_s`."""
    if not actuation.motors_on:
        return (0.0, 0.0, 0.0)
    dx, dy, dz = fixed.damping
    p, r, y = later
    if actuation.rate_sp_frd_radps is not None:
        sp, sr, sy = actuation.rate_sp_frd_radps.tolist()
        return dx * (sp - p), dy * (sr - r), dz * (sy - y)
    qw, qx, qy, qz = q
    ex, ey, ez = _to_rotation_vector(_multiply((qw, -qx, -qy, -qz), tuple(actuation.q_sp_wxyz.tolist())))
    kx, ky, kz = fixed.stiffness
    return (
        kx * (ex - rate[0] * later_s) - dx * p,
        ky * (ey - rate[1] * later_s) - dy * r,
        kz * (ez - rate[2] * later_s) - dz * y,
    )


def _lift(thrust_n: float, a: Four, b: Four) -> Three:
    """Minus the thrust's force (N, NED) halfway between two attitudes."""
    w, x, y, z = a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]
    square = w * w + x * x + y * y + z * z
    scale = thrust_n / square
    return 2.0 * (x * z + w * y) * scale, 2.0 * (y * z - w * x) * scale, (square - 2.0 * (x * x + y * y)) * scale


def _acceleration(velocity: list[float], lift: Three, push: list[float], fixed: _Plain) -> Three:
    x, y, z = velocity
    speed = math.sqrt(x * x + y * y + z * z)
    (dx, dy, dz), (ex, ey, ez), (cx, cy, cz) = fixed.viscous, fixed.quadratic, fixed.coulomb
    dry, per_kg = fixed.dry_per_mps, fixed.per_kg
    return (
        (push[0] - (ex * speed + dx) * x - cx * math.tanh(x * dry) - lift[0]) * per_kg,
        (push[1] - (ey * speed + dy) * y - cy * math.tanh(y * dry) - lift[1]) * per_kg,
        (push[2] - (ez * speed + dz) * z - cz * math.tanh(z * dry) - lift[2]) * per_kg + GRAVITY_MPS2,
    )


def _standing(before: PlantState, thrust_n: float, q: Four, params: PlantParams) -> PlantState:
    x, y, _ = before.position_ned_m.tolist()
    w, _, _, z = q
    length = math.sqrt(w * w + z * z)
    level = np.array([w / length, 0.0, 0.0, z / length]) if length > 1e-9 else np.array([1.0, 0.0, 0.0, 0.0])
    place = np.array([x, y, params.ground_z_m])
    still = np.zeros(3)
    return PlantState(place, still, level, still, np.asarray(thrust_n), still, _STANDING, still)


def _multiply(a: Four, b: Four) -> Four:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _unit(q: Four) -> Four:
    w, x, y, z = q
    per_length = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * per_length, x * per_length, y * per_length, z * per_length


def _to_rotation_vector(q: Four) -> Three:
    w, x, y, z = q
    sine = math.sqrt(x * x + y * y + z * z)
    scale = math.copysign(2.0, w)
    if sine > 1e-12:
        scale *= math.atan2(sine, abs(w)) / sine
    return scale * x, scale * y, scale * z


_IN_AIR = np.zeros((), dtype=bool)
_STANDING = np.ones((), dtype=bool)
