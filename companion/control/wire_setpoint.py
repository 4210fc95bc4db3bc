"""Correction of the autopilot's horizon in the setpoint that is sent. No I/O, no clock.

It comes after law and guard, so it is the same for every law; law and health checks keep the uncorrected setpoint as
the one sent, which is the attitude the vehicle really takes. The corrected setpoint is limited once more, so that the
tilt limit also holds relative to the autopilot's horizon.
"""

import math
from dataclasses import replace

import numpy as np

from companion.control.horizon_correction import (
    Horizon,
    HorizonInput,
    HorizonRules,
    corrected,
    correction_of,
    is_worth_sending,
    no_horizon,
    step,
)
from companion.core.types import Array, AttitudeThrust, Flag
from companion.core.values import value
from companion.geometry.array_math import any_true, column, where, where_each
from companion.guard.limits import Limits, limit_setpoint

_STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@value(kw_only=True)
class Wire:
    """Setpoint on the wire in one cycle, and the inputs it was computed from."""

    setpoint: AttitudeThrust
    """Setpoint on the wire."""
    last: AttitudeThrust
    """Setpoint on the wire before it."""
    is_new: Flag
    """True where the law's setpoint differs from the one before."""
    inputs: HorizonInput
    horizon: Horizon
    dt_s: float
    begun: bool
    """True if the correction began with this cycle."""


class WireSetpoint:
    """Correction, and its part in the setpoint last sent; one vehicle, or a batch of shape `lead`.

    The correction in a setpoint stays while the law sends nothing new, until it is off by more than a degree.
    """

    def __init__(self, rules: HorizonRules, limits: Limits, lead: tuple[int, ...] = ()) -> None:
        self._rules, self._lead = rules, lead
        self._limits = replace(limits, min_thrust=0.0, max_thrust_rate_ps=math.inf)
        """Limits without thrust: it is unchanged and within the limits already; on the ground it may be idle."""
        self.reset()

    def reset(self) -> None:
        """Reset to no correction and no previous setpoint."""
        self._horizon = self._held = no_horizon(self._lead)
        self._begun = True
        self._turn_w: Array = np.broadcast_to(_STRAIGHT, (*self._lead, 4))

    def put(
        self, setpoint: AttitudeThrust, is_new: Flag, last: AttitudeThrust, inputs: HorizonInput, dt_s: float
    ) -> Wire:
        """Return the setpoint to send, `dt_s` after `last`; `is_new` where the law's `setpoint` has changed."""
        begun, self._begun = self._begun, False
        self._horizon = step(self._horizon, inputs, self._rules, dt_s)
        on_wire = self._corrected(setpoint, is_new, last, inputs, dt_s) if self._rules.enabled else setpoint
        return Wire(
            setpoint=on_wire, last=last, is_new=is_new, inputs=inputs, horizon=self._horizon, dt_s=dt_s, begun=begun
        )

    def _corrected(
        self, setpoint: AttitudeThrust, is_new: Flag, last: AttitudeThrust, inputs: HorizonInput, dt_s: float
    ) -> AttitudeThrust:
        fresh = is_new | is_worth_sending(self._horizon, self._held, self._rules)
        if any_true(fresh):
            self._held = where_each(fresh, self._horizon, self._held)
            turn_w = correction_of(self._horizon, inputs.q_w_flu_wxyz)
            self._turn_w = where(column(fresh), turn_w, self._turn_w)
        return limit_setpoint(corrected(setpoint, self._turn_w), last, self._limits, dt_s).setpoint
