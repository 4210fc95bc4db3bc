"""Geometric PID on force: Lee, Leok, McClamroch 2010, with the integral of Goodarzi, Lee, Lee 2013.

T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010, eq. 15 for the
force; D. Mellinger, V. Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, has the same;
F. Goodarzi, D. Lee, T. Lee, "Geometric nonlinear PID control of a quadrotor UAV on SE(3)", ECC 2013, eq. 11 the
integral. Their attitude loops are PX4's here. Gains are per kilogram; gravity comes with the conversion to thrust.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import Diagonal, NotNegative, Positive, diagonal
from companion.control.peers.outer_loop import FeedbackGains, FeedbackLaw, LoopMemory
from companion.core.types import Array
from companion.core.values import value


class GeometricPidGains(FeedbackGains):
    """Gains of the geometric PID."""

    ki_per_s2: Diagonal = diagonal(2.0, 2.0, 2.0, note="rate of the integral per e_v + c e_x, 1/s^2")
    c_per_s: NotNegative = Field(1.0, description="c: weight of the position error in the integral, 1/s")
    integral_max_mps2: Positive = Field(3.0, description="limit of the integral per axis, m/s^2")


@value
class GeometricPidMemory:
    """Memory of the law: shared parts, and the integral (m/s^2), (..., 3)."""

    loop: LoopMemory
    integral: Array


@dataclass(frozen=True)
class GeometricPid(FeedbackLaw[GeometricPidMemory]):
    """Law u = p_d'' - k_x e_x - k_v e_v - sat(k_i int(e_v + c e_x)); the integral is its estimated disturbance."""

    gains: GeometricPidGains

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> GeometricPidMemory:
        """Return the memory whose integral compensates a known disturbance (m/s^2), (..., 3)."""
        return GeometricPidMemory(self.begin(now), self._limited(known_disturbance_w_mps2 + 0.0 * now.position_w_m))

    def step(self, memory: GeometricPidMemory, now: ControlInput) -> tuple[GeometricPidMemory, ControlOutput]:
        """Return the memory and the command of one cycle."""
        g = self.gains
        sight, loop = self.look(memory.loop, now)
        errors = e_x, e_v = sight.errors(now.reference, memory.integral)
        integral = self._limited(memory.integral + now.dt_s * g.ki_per_s2 * (e_v + g.c_per_s * e_x))
        wanted = self.feedback(errors, now.reference) - integral
        loop, output = self.send(loop, wanted, now, {"x1": e_x, "disturbance": integral})
        return GeometricPidMemory(loop, integral), output

    def _limited(self, integral: Array) -> Array:
        return np.clip(integral, -self.gains.integral_max_mps2, self.gains.integral_max_mps2)
