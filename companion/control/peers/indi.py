"""Incremental nonlinear dynamic inversion (INDI) on acceleration: Smeur, de Croon, Chu 2018.

E. J. J. Smeur, G. C. H. E. de Croon, Q. Chu, "Cascaded incremental nonlinear dynamic inversion for MAV disturbance
rejection", Control Engineering Practice 73, 2018: the outer loop, eqs. 15 to 19. The increment is wanted less measured
acceleration, added to what the rotors do; both go through the same second-order low pass, so that they are equally old.
Here the measured one comes from the estimated velocity (there is no accelerometer), what the rotors do from measured
attitude and the thrust really sent; attitude and thrust are turned into an acceleration and back exactly, not by G^-1.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import Positive
from companion.control.peers.outer_loop import FeedbackGains, FeedbackLaw, LoopMemory
from companion.core.types import Array, Scalar
from companion.core.values import value

_DAMPING = 0.5**0.5
"""Butterworth."""


class IndiGains(FeedbackGains):
    """Gains of INDI."""

    filter_radps: Positive = Field(6.0, le=40.0, description="cut-off of the low pass of both accelerations, rad/s")


@value
class LowPass:
    """Second-order low pass: its output and the rate of it, (..., 3)."""

    output: Array
    rate: Array

    def stepped(self, source: Array, cutoff_radps: Scalar, dt_s: Scalar) -> "LowPass":
        """Return the filter after `dt_s` (s)."""
        bend = cutoff_radps * cutoff_radps * (source - self.output) - (2.0 * _DAMPING * cutoff_radps) * self.rate
        rate = self.rate + dt_s * bend
        return LowPass(self.output + dt_s * rate, rate)


@value
class IndiMemory:
    """Memory of the law: shared parts, and both low passes."""

    loop: LoopMemory
    velocity: LowPass
    """Its rate is the measured acceleration."""
    acting: LowPass


@dataclass(frozen=True)
class Indi(FeedbackLaw[IndiMemory]):
    """Law u = u_f + (a_d - a_f): the filtered acceleration of the rotors, and what the filtered measured one lacks."""

    gains: IndiGains

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> IndiMemory:
        """Return the memory with filters at rest under a known disturbance (m/s^2), (..., 3)."""
        nothing = np.zeros_like(now.position_w_m)
        acting = now.sent_accel_w_mps2 + nothing
        velocity = LowPass(now.velocity_w_mps, acting + known_disturbance_w_mps2)
        return IndiMemory(self.begin(now), velocity, LowPass(acting, nothing))

    def step(self, memory: IndiMemory, now: ControlInput) -> tuple[IndiMemory, ControlOutput]:
        """Return the memory and the command of one cycle."""
        sight, loop = self.look(memory.loop, now)
        cutoff, dt_s = self.gains.filter_radps, sight.elapsed_s
        velocity = memory.velocity.stepped(now.velocity_w_mps, cutoff, dt_s)
        acting = memory.acting.stepped(sight.acting_w_mps2, cutoff, dt_s)
        measured = velocity.rate
        errors = sight.errors(now.reference, measured - acting.output)
        wanted = acting.output + (self.feedback(errors, now.reference) - measured)
        signals = {"x1": errors[0], "disturbance": measured - acting.output, "measured": measured}
        loop, output = self.send(loop, wanted, now, signals)
        return IndiMemory(loop, velocity, acting), output
