"""The arms' place in the simulated world: servos move the joints, the links' motion pushes the vehicle.

PX4's rate loop has an integrator, so a lasting torque (a centre of mass off the middle) tilts the vehicle only until it
is trimmed out; here that is a first-order high-pass with the time constant of PX4's own rate gains, P / I.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mock_autopilot.arm_bodies import (
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
from mock_autopilot.plant import Each, PlantState, Wrench
from mock_autopilot.quaternion import Array

JOINT_COUNT = 2 * JOINTS_PER_ARM
_OUTWARD = (1.0, -1.0)
"""Right arm first; body y points right."""


class Servos(Protocol):
    """Eight servos in the joints' order; angles are the servos' own, from their position 0."""

    def step(self, dt_s: float, load_nm: tuple[float, ...]) -> None:
        """Let `dt_s` pass under these loads (N m, positive turns the servo towards greater angles)."""

    def motion(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """True angles (rad), rates (rad/s) and accelerations (rad/s^2)."""


@dataclass(frozen=True)
class Assembly:
    """How the arms are put together and onto the vehicle."""

    bodies: ArmBodies = field(default_factory=ArmBodies)
    direction: tuple[int, ...] = (1,) * JOINT_COUNT
    """Whether each servo turns as its joint's sign says."""
    zero_rad: tuple[float, ...] = ((math.pi,) * 3 + (math.radians(150.0),)) * 2
    """Each servo's own angle at its joint's zero."""
    inertia_kgm2: Three = (0.11, 0.10, 0.13)
    """Of the whole vehicle about its body axes. Added up from parts, not measured: four motors with propellers of
    0.2 kg at 0.33 m, a box of 2.5 kg, booms, and the arms' 0.8 kg hanging 0.2 m low."""


class Arms:
    """Both arms; `step` with the physics."""

    def __init__(self, assembly: Assembly, servos: Servos, mass_kg: Each, trim_time_s: Three) -> None:
        self.assembly, self.servos = assembly, servos
        self._mass_kg, self._trim_time_s = float(mass_kg), trim_time_s
        self._trimmed: Three = (0.0, 0.0, 0.0)
        self._rate: Three | None = None
        self.now = self.joint_states()

    def joint_states(self) -> tuple[JointState, JointState]:
        """Right arm, left arm: the true joint motion."""
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
        """True joint angles, claws included, (8,)."""
        angle, _, _ = self.servos.motion()
        return np.asarray(np.array(self.assembly.direction) * (np.array(angle) - np.array(self.assembly.zero_rad)))

    def step(self, vehicle: PlantState, dt_s: float) -> Wrench:
        """Move the joints by `dt_s`; what the links then do to the vehicle: force (N, NED) and push (rad/s^2, FRD)."""
        self.servos.step(dt_s, self._loads())
        self.now = self.joint_states()
        right, left = (
            arm_motion(self.assembly.bodies, state, outward) for state, outward in zip(self.now, _OUTWARD, strict=True)
        )
        moving = add(right, left)
        force_frd = self._force(moving, _three(vehicle.rate_frd_radps.tolist()), dt_s)
        force_ned = _turned(vehicle.q_ned_frd_wxyz, force_frd)
        return Wrench(np.array(force_ned), np.array(self._push(moving, vehicle, dt_s)))

    def _loads(self) -> tuple[float, ...]:
        loads: list[float] = []
        for state in self.now:
            loads += [*gravity_load_nm(self.assembly.bodies, state.angle), 0.0]
        return tuple(sign * load for sign, load in zip(self.assembly.direction, loads, strict=True))

    def _force(self, moving: Moving, rate: Three, dt_s: float) -> Three:
        """Minus the change of the links' momentum, the turning of the body included (Coriolis, Euler, centrifugal)."""
        before = self._rate or rate
        self._rate = rate
        turning = _three((now - then) / dt_s for now, then in zip(rate, before, strict=True))
        coriolis = cross(rate, moving.momentum)
        euler = cross(turning, moving.moment)
        centrifugal = cross(rate, cross(rate, moving.moment))
        return _three(-(moving.force[i] + 2.0 * coriolis[i] + euler[i] + centrifugal[i]) for i in range(3))

    def _push(self, moving: Moving, vehicle: PlantState, dt_s: float) -> Three:
        """Angular acceleration: the links' reaction, and the thrust that does not go through the centre of mass."""
        if bool(vehicle.on_ground):
            self._trimmed = (0.0, 0.0, 0.0)  # PX4 resets its integrators on the ground
            return (0.0, 0.0, 0.0)
        lever = cross(moving.moment, (0.0, 0.0, -float(vehicle.thrust_n) / self._mass_kg))
        raw = _three(-(moving.torque[i] + lever[i]) / self.assembly.inertia_kgm2[i] for i in range(3))
        push = _three(raw[i] - self._trimmed[i] for i in range(3))
        self._trimmed = _three(self._trimmed[i] + push[i] * dt_s / self._trim_time_s[i] for i in range(3))
        return push


def _turned(q_wxyz: Array, v: Three) -> Three:
    """A body vector in world axes: v + 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = q_wxyz.tolist()
    u = (x, y, z)
    once = cross(u, v)
    twice = cross(u, once)
    return (
        v[0] + 2.0 * (w * once[0] + twice[0]),
        v[1] + 2.0 * (w * once[1] + twice[1]),
        v[2] + 2.0 * (w * once[2] + twice[2]),
    )


def _three(values: Iterable[float]) -> Three:
    x, y, z = values
    return x, y, z
