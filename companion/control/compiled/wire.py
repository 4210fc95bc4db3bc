"""Correction of the autopilot's horizon in flight: in compiled code where there is any, with the same numbers."""

from functools import cached_property
from struct import Struct

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import pointers, quick_library
from companion.control.horizon_correction import Horizon, HorizonInput, HorizonRules, no_horizon
from companion.control.wire_setpoint import Wire, WireSetpoint
from companion.core.types import Array, AttitudeThrust, Flag
from companion.core.values import value
from companion.guard.limits import Limits


@value(kw_only=True)
class Horizons:
    """State of the correction."""

    horizon: Horizon
    held: Horizon
    turn_w: Array


@value(kw_only=True)
class Sending:
    """Setpoint to be corrected, and what it is corrected by."""

    setpoint: AttitudeThrust
    is_new: Flag
    last: AttitudeThrust
    inputs: HorizonInput
    dt_s: float


class NumberedWire(WireSetpoint):
    """Correction whose state can be set."""

    def hold(self, before: Horizons) -> None:
        """Take a state."""
        self._horizon, self._held, self._turn_w = before.horizon, before.held, before.turn_w

    def horizons(self) -> Horizons:
        """Return the state."""
        return Horizons(horizon=self._horizon, held=self._held, turn_w=self._turn_w)


_STATE = 16
NO_HORIZONS = Horizons(horizon=no_horizon(), held=no_horizon(), turn_w=np.array((1.0, 0.0, 0.0, 0.0)))


def corrected(before: Horizons, given: Sending, rules: HorizonRules, limits: Limits) -> tuple[Horizons, AttitudeThrust]:
    """Correct the autopilot's horizon in a setpoint, by rules that are enabled."""
    wire = NumberedWire(HorizonRules(**vars(rules) | {"enabled": True}), limits)
    wire.hold(before)
    put = wire.put(given.setpoint, given.is_new, given.last, given.inputs, given.dt_s)
    return wire.horizons(), put.setpoint


class CompiledWire(Wire):
    """Setpoint on the wire, corrected by compiled code."""

    _numbers: Array

    @cached_property
    def horizon(self) -> Horizon:
        """State of the correction after it."""
        return Horizon(*self._numbers.tolist())


_GIVEN = Struct("27d")


class FlightWire(WireSetpoint):
    """Correction for one vehicle in flight."""

    def __init__(self, rules: HorizonRules, limits: Limits) -> None:
        self._code = quick_library() if rules.enabled else None
        self._state, self._given, self._out = np.empty(_STATE), np.empty(_GIVEN.size // 8), np.empty(5)
        parameters = np.concatenate([flat(part, part)[0] for part in (rules, limits)])
        self._parameters = parameters
        self._pointers = pointers((self._state, self._given, parameters, self._out))
        super().__init__(rules, limits)

    def reset(self) -> None:
        """Reset to no correction and no previous setpoint."""
        super().reset()
        self._state[:] = flat(NO_HORIZONS, NO_HORIZONS)[0]

    def put(
        self, setpoint: AttitudeThrust, is_new: Flag, last: AttitudeThrust, inputs: HorizonInput, dt_s: float
    ) -> Wire:
        """Return the setpoint to send; see `WireSetpoint.put`."""
        if self._code is None:
            return super().put(setpoint, is_new, last, inputs, dt_s)
        numbers = (
            *(*setpoint.q_w_flu_wxyz.tolist(), setpoint.thrust, is_new),
            *(*last.q_w_flu_wxyz.tolist(), last.thrust),
            *(*inputs.q_w_flu_wxyz.tolist(), *inputs.rate_flu_radps.tolist(), inputs.age_s),
            *(*inputs.autopilot_q_w_flu_wxyz.tolist(), inputs.autopilot_age_s, inputs.trusted, inputs.flying, dt_s),
        )
        _GIVEN.pack_into(self._given.data, 0, *numbers)
        self._code.wire_put(self._pointers)
        begun, self._begun = self._begun, False
        out, wire = self._out.copy(), CompiledWire.__new__(CompiledWire)
        vars(wire).update(
            setpoint=AttitudeThrust(out[:4], out[4:].reshape(())),
            last=last,
            is_new=is_new,
            inputs=inputs,
            dt_s=dt_s,
            begun=begun,
            _numbers=self._state[:6].copy(),
        )
        return wire
