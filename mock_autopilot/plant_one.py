"""The same physics as plant.step for exactly one vehicle, in plain floats: faster than numpy on 3-vectors.

The equations are plant.py's, term by term; tests/mock_autopilot/test_plant.py holds the two together to rounding.
"""

import math

import numpy as np

from mock_autopilot.plant import GRAVITY_MPS2, Actuation, PlantParams, PlantState, Wrench

Four = tuple[float, float, float, float]
Three = tuple[float, float, float]


def step(state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float) -> PlantState:
    """Advance one vehicle (arrays of shape (3,)) by `dt_s`; see plant.step."""
    thrust_n = _thrust(state, actuation, params, dt_s)
    q, rate, turn = _attitude(state, actuation, wrench, params, dt_s)
    w, x, y, z = q
    down = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    velocity, acceleration = _translation(state, wrench.force_ned_n.tolist(), thrust_n, down, params, dt_s)
    place = [p + v * dt_s for p, v in zip(state.position_ned_m.tolist(), velocity, strict=True)]
    if place[2] >= params.ground_z_m and velocity[2] >= 0.0:
        return _standing(state, thrust_n, q, params)
    return PlantState(
        np.array(place),
        np.array(velocity),
        np.array(q),
        np.array(rate),
        np.asarray(thrust_n),
        np.array(acceleration),
        _IN_AIR,
        np.array(turn),
    )


def _thrust(state: PlantState, actuation: Actuation, params: PlantParams, dt_s: float) -> float:
    before = float(state.thrust_n)
    signal = float(actuation.signal)
    wanted = 0.0
    if actuation.motors_on and not math.isnan(signal):
        s, c = min(max(signal, 0.0), 1.0), params.motor_curve
        wanted = params.max_thrust_n * (c * s * s + (1.0 - c) * s)
    return before + (wanted - before) * (1.0 - math.exp(-dt_s / params.thrust_lag_s))


def _attitude(
    state: PlantState, actuation: Actuation, wrench: Wrench, params: PlantParams, dt_s: float
) -> tuple[Four, Three, Three]:
    q: Four = tuple(state.q_ned_frd_wxyz.tolist())
    rate: Three = tuple(state.rate_frd_radps.tolist())
    wanted = _wanted_turn(q, rate, actuation, params)
    turn, turned = [], []
    push = wrench.angular_frd_radps2.tolist()
    for axis, before in enumerate(state.turn_frd_radps2.tolist()):
        now = before + (wanted[axis] - before) * (1.0 - math.exp(-dt_s / params.torque_lag_s[axis]))
        turn.append(now)
        turned.append(rate[axis] + (now + push[axis]) * dt_s)
    p, r, y = turned
    small = _from_rotation_vector(p * dt_s, r * dt_s, y * dt_s)
    return _unit(_multiply(q, small)), (p, r, y), (turn[0], turn[1], turn[2])


def _wanted_turn(q: Four, rate: Three, actuation: Actuation, params: PlantParams) -> Three:
    if not actuation.motors_on:
        return (0.0, 0.0, 0.0)
    wn, zeta = params.attitude_bandwidth_radps, params.attitude_damping
    if actuation.rate_sp_frd_radps is not None:
        sp = actuation.rate_sp_frd_radps.tolist()
        a, b, c = (2.0 * zeta[i] * wn[i] * (sp[i] - rate[i]) for i in range(3))
        return (a, b, c)
    w, x, y, z = q
    error = _to_rotation_vector(_multiply((w, -x, -y, -z), tuple(actuation.q_sp_wxyz.tolist())))
    a, b, c = (wn[i] * wn[i] * error[i] - 2.0 * zeta[i] * wn[i] * rate[i] for i in range(3))
    return (a, b, c)


def _translation(
    state: PlantState, force: list[float], thrust_n: float, down: Three, params: PlantParams, dt_s: float
) -> tuple[list[float], list[float]]:
    v = state.velocity_ned_mps.tolist()
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    velocity, acceleration = [], []
    for axis in range(3):
        drag = params.viscous_npm[axis] * v[axis] + params.quadratic_npm2[axis] * speed * v[axis]
        dry = params.coulomb_n[axis] * math.tanh(v[axis] / params.coulomb_width_mps)
        push = force[axis] - drag - dry - thrust_n * down[axis]
        a = push / params.mass_kg + (GRAVITY_MPS2 if axis == 2 else 0.0)
        acceleration.append(a)
        velocity.append(v[axis] + a * dt_s)
    return velocity, acceleration


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
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def _from_rotation_vector(x: float, y: float, z: float) -> Four:
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return (math.cos(0.5 * angle), scale * x, scale * y, scale * z)


def _to_rotation_vector(q: Four) -> Three:
    w, x, y, z = q
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (scale * x, scale * y, scale * z)


_IN_AIR = np.zeros((), dtype=bool)
_STANDING = np.ones((), dtype=bool)
