"""L1 adaptive augmentation of a geometric law: Wu et al. 2022.

Z. Wu, S. Cheng, K. A. Ackerman, A. Gahlawat, A. Lakshmanan, P. Zhao, N. Hovakimyan, "L1 adaptive augmentation for
geometric tracking control of quadrotors", ICRA 2022: state predictor, piecewise-constant adaptation and low pass of the
translation. Their rotational part is PX4's here, so the whole force disturbance is matched by the commanded
acceleration; the baseline is the same geometric law, without its integral.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import Positive
from companion.control.peers.outer_loop import FeedbackGains, FeedbackLaw, LoopMemory, Sight
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import math_module, where_each


class L1Gains(FeedbackGains):
    """Gains of the L1 augmentation."""

    predictor_radps: Positive = Field(5.0, le=60.0, description="A_s = -this: pole of the state predictor, rad/s")
    filter_radps: Positive = Field(4.0, le=40.0, description="cut-off of the low pass C(s), rad/s")


@value
class Adaptation:
    """State of the adaptation; vectors (..., 3) in W."""

    velocity: Array
    """Predicted velocity v_hat, m/s."""
    error: Array
    """v_tilde = v_hat - v at the last frame, m/s."""
    sigma: Array
    """Estimated disturbance sigma_hat, m/s^2."""
    filtered: Array
    """C(s) sigma_hat: what is taken off the command."""
    acting: Array
    """Acceleration by the rotors at the last capture."""


@value
class L1Memory:
    """Memory of the law."""

    loop: LoopMemory
    adaptation: Adaptation


@dataclass(frozen=True)
class L1Adaptive(FeedbackLaw[L1Memory]):
    """Law u = u_geometric - C(s) sigma_hat."""

    gains: L1Gains

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> L1Memory:
        """Return the memory that compensates a known disturbance (m/s^2), (..., 3)."""
        known = known_disturbance_w_mps2 + np.zeros_like(now.position_w_m)
        return L1Memory(self.begin(now), self._at_rest(known, now.sent_accel_w_mps2, now))

    def step(self, memory: L1Memory, now: ControlInput) -> tuple[L1Memory, ControlOutput]:
        """Return the memory and the command of one cycle."""
        sight, loop = self.look(memory.loop, now)
        adapted = self.adapted(memory.adaptation, sight, now)
        errors = sight.errors(now.reference, adapted.filtered)
        wanted = self.feedback(errors, now.reference) - adapted.filtered
        signals = {"x1": errors[0], "disturbance": adapted.filtered, "sigma": adapted.sigma}
        loop, output = self.send(loop, wanted, now, signals)
        return L1Memory(loop, adapted), output

    def adapted(self, before: Adaptation, sight: Sight, now: ControlInput) -> Adaptation:
        """Advance the adaptation to a new frame; without one only the low pass moves.

        v_hat' = a + sigma_hat + A_s v_tilde; sigma_hat = -Phi^-1 e^(A_s T) v_tilde, Phi = A_s^-1 (e^(A_s T) - I).
        The estimate is dead beat for frames at their usual distance, so after a longer gap it begins again.
        """
        rotors, step_s = sight.acting_w_mps2, sight.elapsed_s
        acting = 0.5 * (before.acting + rotors)
        velocity = before.velocity + step_s * (acting + before.sigma - self.gains.predictor_radps * before.error)
        error = velocity - now.velocity_w_mps
        turn = -self.gains.filter_radps * now.dt_s
        share = -math_module(turn).expm1(turn)
        filtered = before.filtered + share * (before.sigma - before.filtered)
        sigma = -self._gain * error
        filtered_now = before.filtered + share * (sigma - before.filtered)
        usual = Adaptation(velocity, error, sigma, filtered_now, rotors)
        waiting = Adaptation(before.velocity, before.error, before.sigma, filtered, rotors)
        again = self._at_rest(filtered, rotors, now)
        fresh, gap = step_s > 0.5 * self.period_s, step_s > 1.5 * self.period_s
        return where_each(gap, again, where_each(fresh, usual, waiting))

    def _at_rest(self, known: Array, acting: Array, now: ControlInput) -> Adaptation:
        """Return the adaptation that has settled on a disturbance (m/s^2), (..., 3)."""
        error = -known / (self._gain + self.gains.predictor_radps)
        return Adaptation(now.velocity_w_mps + error, error, known, known, acting + np.zeros_like(known))

    @cached_property
    def _gain(self) -> Scalar:
        """Phi^-1 e^(A_s T), 1/s."""
        pole = self.gains.predictor_radps
        gain: Scalar = pole / np.expm1(pole * self.period_s)
        return gain
