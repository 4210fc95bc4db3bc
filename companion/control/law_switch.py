"""Switch from one control law to another in the air: the command added to the new law's until it flies alone.

A law that can be seeded (`SeededLaw`) begins with the known disturbance; only the difference between the last setpoint
and its first command fades out, quickly. Any other law begins with nothing learnt: the command that compensates the
disturbance is held for it and withdrawn slowly, or sooner as the law compensates it by itself.
"""

from dataclasses import replace
from math import cos, pi

import numpy as np

from companion.control.controller import ControlInput, ControlOutput
from companion.core.types import Array
from companion.core.values import value

BLEND_S = 0.25
"""Time in which the difference between the last setpoint and the new law's first command fades: no jump is sent."""
HELD_S = 60.0
"""Time for which the known disturbance is compensated for a law that cannot be seeded: an integral of 0.3 1/s^3, the
slowest that is shipped, loses 0.06 m to a wind of 0.74 m/s^2 that is withdrawn so slowly."""
_COUNTERS_S = 0.5
"""Time constant of the low pass of the share that such a law compensates by itself."""
_WORTH_MPS2 = 0.05
"""Smallest disturbance for which the share of the law is measured."""
_SENT_SHARE = 0.02
"""Change of the held share that is sent without an event of the law."""


@value
class LawSwitch:
    """State of a switch in progress."""

    disturbance_w_mps2: Array
    """Disturbance compensated for the new law, (3,) in W; 0 for a law that was seeded with it."""
    gone_s: float = 0.0
    gap_w_mps2: Array | None = None
    """Last setpoint less the first command."""
    countered: float = 0.0
    """Share of the disturbance that the law compensates by itself, low-passed."""
    left: float = 1.0
    """Share that is still compensated for it; it never grows."""
    sent_left: float = 1.0
    """That share when a command was last sent."""

    @property
    def over(self) -> bool:
        """True once the new law flies alone."""
        held = self.sent_left > 0.0 and bool(self.disturbance_w_mps2.any())
        return self.gone_s >= BLEND_S and not held

    def blend(self, output: ControlOutput, now: ControlInput) -> "tuple[ControlOutput, LawSwitch]":
        """Return the new law's command with what is added to it, sent whenever that changes, and the state after it."""
        held = output.accel_w_mps2 - self.left * self.disturbance_w_mps2
        gap = now.sent_accel_w_mps2 - now.known_accel_w_mps2 - held if self.gap_w_mps2 is None else self.gap_w_mps2
        accel = held + _faded(self.gone_s, BLEND_S) * gap
        gone_s, countered = self.gone_s + now.dt_s, self._countered(output, now)
        left = min(self.left, _faded(gone_s, HELD_S), max(0.0, 1.0 - countered))
        moved = self.gone_s < BLEND_S or self.left <= 0.0 or self.sent_left - self.left > _SENT_SHARE
        event = np.ones_like(output.event) if moved else output.event
        sent_left = self.left if event.any() else self.sent_left
        return replace(output, accel_w_mps2=accel, event=event), LawSwitch(
            self.disturbance_w_mps2, gone_s, gap, countered, left, sent_left
        )

    def _countered(self, output: ControlOutput, now: ControlInput) -> float:
        """Return the share of the disturbance that the law's own command compensates, low-passed."""
        d = self.disturbance_w_mps2
        square = float(d.dot(d))
        if square < _WORTH_MPS2**2:
            return 0.0
        own = output.accel_w_mps2 + now.known_accel_w_mps2 - now.reference.acceleration_w_mps2
        return self.countered + min(now.dt_s / _COUNTERS_S, 1.0) * (-float(own.dot(d)) / square - self.countered)


def _faded(gone_s: float, over_s: float) -> float:
    """Return a weight that falls smoothly from 1 at the beginning to 0 after `over_s`."""
    return 0.5 + 0.5 * cos(pi * min(gone_s / over_s, 1.0))
