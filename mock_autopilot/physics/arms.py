"""The arms' place in the simulated world: servos move the joints, the links' motion pushes the vehicle.

PX4's rate loop has an integrator, so a lasting torque (a centre of mass off the middle) tilts the vehicle only until it
is trimmed out; here that is a first-order high-pass with the time constant of PX4's own rate gains, P / I.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mock_autopilot.physics.arm_bodies import (
    JOINTS_PER_ARM,
    ArmBodies,
    JointState,
    Moving,
    Three,
    add,
    arm_motion,
    cross,
    gravity_load_nm,
)
from mock_autopilot.physics.plant import GRAVITY_MPS2, Each, EachAxis, PlantState, Wrench
from mock_autopilot.physics.plant_one import OneState
from mock_autopilot.physics.quaternion import Array

JOINT_COUNT = 2 * JOINTS_PER_ARM
OUTWARD = (1.0, -1.0)
"""Right arm first; body y points right."""


class Servos(Protocol):
    """Eight servos in the joints' order; angles are the servos' own, from their position 0."""

    def step(self, dt_s: float, load_nm: tuple[float, ...]) -> None:
        """Let `dt_s` pass under these loads (N m, positive turns the servo towards greater angles)."""

    def motion(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """True angles (rad), rates (rad/s) and accelerations (rad/s^2)."""


@dataclass(frozen=True)
class Assembly:
    """The geometry, masses and servo directions of the arms, and the vehicle's inertia."""

    bodies: ArmBodies = field(default_factory=ArmBodies)
    direction: tuple[int, ...] = (1,) * JOINT_COUNT
    """1 or -1: the sense in which each servo turns its joint."""
    zero_rad: tuple[float, ...] = ((math.pi,) * 3 + (math.radians(150.0),)) * 2
    """Each servo's own angle at its joint's zero."""
    inertia_kgm2: Three = (0.11, 0.10, 0.13)
    """Moments of inertia about the body axes; added up from parts, not measured: four motors with propellers of
    0.2 kg at 0.33 m, a box of 2.5 kg, booms, and the arms' 0.8 kg hanging 0.2 m low."""

    def loads_nm(self, angle: Sequence[float]) -> tuple[float, ...]:
        """Return the links' weight as torque (N m) on each servo, (8,), at the servos' own angles (rad), (8,)."""
        sign, zero = self.direction, self.zero_rad
        a, b, c, _, e, f, g, _ = [s * (servo - null) for s, servo, null in zip(sign, angle, zero, strict=True)]
        right, left = gravity_load_nm(self.bodies, (a, b, c)), gravity_load_nm(self.bodies, (e, f, g))
        return tuple([s * load for s, load in zip(sign, (*right, 0.0, *left, 0.0), strict=True)])


class Coupling:
    """The reaction of moving links on one vehicle or (...,) of them; keeps the last rate and the trim."""

    def __init__(self, trimmed: Moving | None, mass_kg: Each, inertia_kgm2: EachAxis, trim_time_s: Three) -> None:
        """`trimmed` is the pose that the autopilot has trimmed in hover, if any; mass and inertia may differ."""
        self._mass_kg = mass_kg if isinstance(mass_kg, np.ndarray) else float(mass_kg)
        self._inertia_kgm2 = _parts(np.asarray(inertia_kgm2, dtype=float))
        self._trim_time_s = trim_time_s
        nothing = (0.0, 0.0, 0.0)
        self._trimmed = nothing if trimmed is None else self._turning(nothing, trimmed.moment, GRAVITY_MPS2)
        self._rate: Three | None = None

    def step(self, vehicle: PlantState, moving: Moving, dt_s: float) -> Wrench:
        """Return force (N, NED) and angular acceleration (rad/s^2, FRD) over the next `dt_s`."""
        rate, q = _parts(vehicle.rate_frd_radps), _parts(vehicle.q_ned_frd_wxyz)
        thrust_n, grounded = _number(vehicle.thrust_n), _number(vehicle.on_ground)
        force_ned_n, push_frd_radps2 = self.pushed(rate, q, thrust_n, grounded, moving, dt_s)
        return Wrench(_joined(force_ned_n), _joined(push_frd_radps2))

    def pushed(
        self, rate: Three, q: tuple[float, ...], thrust_n: Any, grounded: Any, moving: Moving, dt_s: float
    ) -> tuple[Three, Three]:
        """Do what `step` does, with state and wrench in components: floats, or arrays (...,) of them."""
        return _turned(q, self._force(moving, rate, dt_s)), self._push(moving, thrust_n, grounded, dt_s)

    def _force(self, moving: Moving, rate: Three, dt_s: float) -> Three:
        """Return minus the change of the links' momentum, with the body's rotation (Coriolis, Euler, centrifugal)."""
        (p, q, r), (p0, q0, r0) = rate, self._rate or rate
        self._rate = rate
        moment, (x, y, z), force = moving.moment, moving.momentum, moving.force
        euler = cross(((p - p0) / dt_s, (q - q0) / dt_s, (r - r0) / dt_s), moment)
        i, j, k = cross(rate, moment)
        coriolis = cross(rate, (2.0 * x + i, 2.0 * y + j, 2.0 * z + k))  # and centrifugal
        return (
            -force[0] - euler[0] - coriolis[0],
            -force[1] - euler[1] - coriolis[1],
            -force[2] - euler[2] - coriolis[2],
        )

    def _turning(self, torque: Three, moment: Three, lift_mps2: float) -> Three:
        """Return the angular acceleration by the links' reaction and by thrust that misses the centre of mass."""
        inertia = self._inertia_kgm2
        return (
            (moment[1] * lift_mps2 - torque[0]) / inertia[0],
            -(moment[0] * lift_mps2 + torque[1]) / inertia[1],
            -torque[2] / inertia[2],
        )

    def _push(self, moving: Moving, thrust_n: Any, grounded: Any, dt_s: float) -> Three:
        """Return the angular acceleration that PX4's integrators have not trimmed out; on the ground they are reset."""
        flies = 1.0 - grounded
        x, y, z = self._turning(moving.torque, moving.moment, thrust_n / self._mass_kg)
        (p, q, r), (ps, qs, rs) = self._trimmed, self._trim_time_s
        i, j, k = push = (x - p) * flies, (y - q) * flies, (z - r) * flies
        self._trimmed = (p + i * dt_s / ps) * flies, (q + j * dt_s / qs) * flies, (r + k * dt_s / rs) * flies
        return push


class Arms:
    """Both arms with their servos; `step` them with the physics."""

    def __init__(self, assembly: Assembly, servos: Servos, mass_kg: Each, trim_time_s: Three) -> None:
        self.assembly, self.servos = assembly, servos
        self._coupling = Coupling(None, mass_kg, assembly.inertia_kgm2, trim_time_s)
        self.now = self.joint_states()
        self._motion = self.servos.motion()
        self._loads_nm, self._moving = self._loads_and_sums()

    def joint_states(self) -> tuple[JointState, JointState]:
        """Return the true joint motion of the right and of the left arm."""
        sign, zero = self.assembly.direction, self.assembly.zero_rad
        angle, rate, accel = self.servos.motion()
        right, left = (
            JointState(
                (sign[i] * (angle[i] - zero[i]), sign[j] * (angle[j] - zero[j]), sign[k] * (angle[k] - zero[k])),
                (sign[i] * rate[i], sign[j] * rate[j], sign[k] * rate[k]),
                (sign[i] * accel[i], sign[j] * accel[j], sign[k] * accel[k]),
            )
            for i, j, k in ((0, 1, 2), (4, 5, 6))
        )
        return right, left

    @property
    def joints_rad(self) -> Array:
        """Return the true joint angles, claws included, (8,) in rad."""
        angle, _, _ = self.servos.motion()
        return np.asarray(np.array(self.assembly.direction) * (np.array(angle) - np.array(self.assembly.zero_rad)))

    def step(self, vehicle: PlantState, dt_s: float) -> Wrench:
        """Move the joints by `dt_s`; return the links' force (N, NED) and angular acceleration (rad/s^2, FRD)."""
        return self._coupling.step(vehicle, self._moved(dt_s), dt_s)

    def step_one(self, vehicle: OneState, dt_s: float) -> tuple[Three, Three]:
        """Do what `step` does, in floats."""
        rate, q, thrust_n = vehicle.rate_frd_radps, vehicle.q_ned_frd_wxyz, vehicle.thrust_n
        return self._coupling.pushed(rate, q, thrust_n, vehicle.on_ground, self._moved(dt_s), dt_s)

    def _moved(self, dt_s: float) -> Moving:
        self._look()
        self.servos.step(dt_s, self._loads_nm)
        self._look()
        return self._moving

    def _look(self) -> None:
        """Bring loads and sums up to date; servos held by their friction stand exactly still, and so do these."""
        motion = self.servos.motion()
        if motion != self._motion:
            self._motion, self.now = motion, self.joint_states()
            self._loads_nm, self._moving = self._loads_and_sums()

    def _loads_and_sums(self) -> tuple[tuple[float, ...], Moving]:
        right, left = (
            arm_motion(self.assembly.bodies, state, outward) for state, outward in zip(self.now, OUTWARD, strict=True)
        )
        return self.assembly.loads_nm(self._motion[0]), add(right, left)


def _turned(q_wxyz: tuple[float, ...], v: Three) -> Three:
    """Return a body vector in world axes: v + 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = q_wxyz
    u = (x, y, z)
    once = cross(u, v)
    twice = cross(u, once)
    return (
        v[0] + 2.0 * (w * once[0] + twice[0]),
        v[1] + 2.0 * (w * once[1] + twice[1]),
        v[2] + 2.0 * (w * once[2] + twice[2]),
    )


def _parts(vector: Array) -> Any:
    """Return the components of (..., n): floats for one vector, arrays for many, for the same formulas."""
    return tuple(vector.tolist() if vector.ndim == 1 else np.ascontiguousarray(np.moveaxis(vector, -1, 0)))


def _number(value: NDArray[Any]) -> Any:
    """Return a Python scalar for one vehicle, the array for many."""
    return value if value.ndim else value.item()


def _joined(components: tuple[Any, ...]) -> Array:
    """Stack components into (..., n): the inverse of _parts."""
    return np.stack(components, axis=-1) if isinstance(components[0], np.ndarray) else np.array(components)
