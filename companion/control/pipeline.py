"""Pipeline from reference and state to the setpoint to send: law, conversion, limits. No I/O, no clock."""

from dataclasses import replace
from math import inf

import numpy as np

from companion.control.controller import ControlInput, Controller, ControlOutput, Halves, SeededLaw, TwoHalves
from companion.control.disturbance import Disturbance, estimate_disturbance, no_disturbance
from companion.control.law_switch import LawSwitch
from companion.core.types import Array, AttitudeThrust, Flag, Mask, Reference, Scalar, VehicleState
from companion.core.values import value
from companion.geometry.array_math import absolute, any_true, column, unstack, where
from companion.geometry.attitude import ThrustModel, accel_of_setpoint, limit_tilt, setpoint_of_accel
from companion.geometry.frames import quat_from_yaw
from companion.guard.guard import Guard
from companion.guard.limits import LimitedSetpoint, Limits, limit_setpoint

YAW_STEP_RAD = 0.02
"""Change of the reference's heading that is sent without an event: the paper's trigger ignores the heading."""
_NOTHING = np.zeros(3)


@value
class PipelineOutput:
    """Output of the law in one cycle, and the setpoint inside the limits."""

    reference: Reference
    law_output: ControlOutput
    limited: LimitedSetpoint
    given: ControlInput
    """Inputs of the law."""
    begun: bool
    """True if the law began with this cycle: lift-off, or a switch to another law."""
    is_new: Flag
    """True where the law's setpoint is a new one: at an event, and when the heading has turned."""


class ControlPipeline:
    """Pipeline with the law's memory and its last setpoint; `sent` is the setpoint last sent, which limits the rate.

    For one vehicle, or for a batch of shape `lead`: the leading axes of vehicle states, `sent` and all outputs; thrust
    model and limits are those of the batch. A guard, which is for one vehicle, replaces the plain limits.
    """

    def __init__(
        self,
        controller: Controller,
        model: ThrustModel,
        limits: Limits,
        lead: tuple[int, ...] = (),
        guard: Guard | None = None,
    ) -> None:
        self._model, self._limits, self._lead = model, limits, lead
        self._guard = guard
        self._take(controller)
        self._memory: object = None
        self._decided: object = None
        self._law_setpoint: AttitudeThrust | None = None
        self._yaw_rad: Scalar = 0.0
        self._sent_arm_accel_w_mps2 = _NOTHING
        """Part of the setpoint sent that only compensates the arms."""
        self._disturbance: Disturbance | None = None
        self._switched = False
        """True after a switch until the new law begins."""
        self._switching: LawSwitch | None = None
        self._warm_up()

    @property
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference, s."""
        return self._controller.preview_s

    def forget(self) -> None:
        """Reset the law, so that the next `fly` begins with nothing learnt, as at lift-off."""
        self._memory, self._decided, self._law_setpoint = None, None, None
        self._sent_arm_accel_w_mps2, self._disturbance = _NOTHING, None
        self._switched, self._switching = False, None

    def switch(self, controller: Controller) -> None:
        """Fly another law from the next cycle on: no setpoint jumps, and it knows the disturbance (`LawSwitch`)."""
        self.settle()
        self._take(controller)
        self._memory, self._decided, self._switched = None, None, True

    def _take(self, controller: Controller) -> None:
        self._controller = controller
        self._halves: Halves | None = self._controller if isinstance(self._controller, TwoHalves) else None

    def settle(self) -> dict[str, Array]:
        """Run the second half of the law's cycle, else the next `fly` does; return its additional internal values."""
        if self._decided is None or self._halves is None:
            return {}
        decided, self._decided = self._decided, None  # once only: an error would repeat
        self._memory, late_signals = self._halves.settle(decided)
        return late_signals

    def _decide(self, now: ControlInput) -> ControlOutput:
        self.settle()
        if self._memory is None:
            self._memory = self._begin(now)
        if self._halves is not None:
            self._decided, output = self._halves.decide(self._memory, now)
        else:
            self._memory, output = self._controller.step(self._memory, now)
        return output

    def _begin(self, now: ControlInput) -> object:
        """Return the law's first memory: nothing learnt at lift-off, the known disturbance after a switch."""
        if not self._switched:
            return self._controller.initial(now)
        self._switched = False
        known = _NOTHING if self._disturbance is None else self._disturbance.accel_w_mps2
        if isinstance(self._controller, SeededLaw):
            self._switching = LawSwitch(_NOTHING)
            return self._controller.initial_with(now, known)
        self._switching = LawSwitch(known)
        return self._controller.initial(now)

    def _warm_up(self) -> None:
        """Run the law on the ground: first calls are slow, and the first real one is at lift-off."""
        still, level = np.zeros((*self._lead, 3)), idle_setpoint(np.zeros(self._lead))
        vehicle = VehicleState(0.0, still, still, level.q_w_flu_wxyz, still)
        for _ in range(3):
            self.fly(vehicle, 0.0, Reference(still, still, still, 0.0), level, 0.01)
        self.forget()

    def on_ground(self, yaw_rad: float, thrust: float, sent: AttitudeThrust, dt_s: float) -> LimitedSetpoint:
        """Return a level setpoint while the law is inactive; the rotors may idle.

        Age and fence do not limit it: the vehicle stands, and the guard would level it anyway.
        """
        return limit_setpoint(idle_setpoint(yaw_rad, thrust), sent, replace(self._limits, min_thrust=0.0), dt_s)

    def level(self, yaw_rad: float, thrust: float) -> AttitudeThrust:
        """Return a level setpoint within the limits, without rate limit; the guard's own if it is not valid."""
        level = idle_setpoint(yaw_rad, thrust)
        fallback = level if self._guard is None else self._guard.level(0.0)
        return limit_setpoint(level, fallback, self._limits, inf).setpoint

    def fly(
        self,
        vehicle: VehicleState,
        age_s: Scalar,
        ahead: Reference,
        sent: AttitudeThrust,
        dt_s: float,
        known_accel_w_mps2: Array = _NOTHING,
    ) -> PipelineOutput:
        """Run one cycle; `ahead` is the reference `preview_s` from now, `known_accel_w_mps2` (..., 3) that of the arms.

        In a batch `age_s` is a float or (..., 1), the reference one for all, (3,) and a float, or (..., 3) and (...,).
        Between events the setpoint of the law stays, and the rate limits continue towards it.
        """
        now = self._given(vehicle, age_s, ahead, sent, dt_s, known_accel_w_mps2)
        self._sent_arm_accel_w_mps2 = known_accel_w_mps2
        begun = self._memory is None
        output = self._decide(now)
        if self._switching is not None:
            output, after = self._switching.blend(output, now)
            self._switching = None if after.over else after
        before = no_disturbance(now) if self._disturbance is None else self._disturbance
        self._disturbance = estimate_disturbance(before, now)
        self._law_setpoint, is_new = self._latest(output, output.heading_rad(ahead))
        if self._guard is None:
            limited = limit_setpoint(self._law_setpoint, sent, self._limits, dt_s)
        else:
            limited = self._guard.check(self._law_setpoint, sent, vehicle, float(age_s), dt_s, output.age_s)
        return PipelineOutput(ahead, output, limited, now, begun, is_new)

    def _given(
        self,
        vehicle: VehicleState,
        age_s: Scalar,
        ahead: Reference,
        sent: AttitudeThrust,
        dt_s: float,
        known_accel_w_mps2: Array,
    ) -> ControlInput:
        return ControlInput(
            position_w_m=vehicle.position_w_m,
            velocity_w_mps=vehicle.velocity_w_mps,
            q_w_flu_wxyz=vehicle.q_w_flu_wxyz,
            rate_flu_radps=vehicle.rate_flu_radps,
            age_s=age_s,
            reference=ahead,
            sent_accel_w_mps2=accel_of_setpoint(sent, self._model) + self._sent_arm_accel_w_mps2,
            dt_s=dt_s,
            known_accel_w_mps2=known_accel_w_mps2,
        )

    def _latest(self, output: ControlOutput, yaw_rad: Scalar) -> tuple[AttitudeThrust, Flag]:
        """Return the law's setpoint: a new one where there is an event or the heading has turned, else the held one."""
        held, (event,) = self._law_setpoint, unstack(output.event)
        fresh = (event > 0.0) | (absolute(yaw_rad - self._yaw_rad) > YAW_STEP_RAD)
        if held is not None and not any_true(fresh):
            return held, fresh
        upright = limit_tilt(output.accel_w_mps2, self._limits.max_tilt_rad, self._model.gravity_mps2)
        new = setpoint_of_accel(upright, yaw_rad, self._model)
        if held is None:
            self._yaw_rad = yaw_rad
            return new, fresh | True
        self._yaw_rad = where(fresh, yaw_rad, self._yaw_rad)
        q = where(column(fresh), new.q_w_flu_wxyz, held.q_w_flu_wxyz)
        return AttitudeThrust(q, where(fresh, new.thrust, held.thrust)), fresh


def idle_setpoint(yaw_rad: Scalar, thrust: float = 0.0) -> AttitudeThrust:
    """Return a level setpoint at this heading (...,)."""
    return AttitudeThrust(quat_from_yaw(yaw_rad), np.full(np.shape(yaw_rad), thrust))


def changed(a: AttitudeThrust, b: AttitudeThrust) -> Mask:
    """Return where two setpoints differ, even in the last bit, shape (...,)."""
    if a.q_w_flu_wxyz.ndim == 1:  # a tenth of the time that numpy takes for so few numbers
        return np.array(a.q_w_flu_wxyz.tolist() != b.q_w_flu_wxyz.tolist() or a.thrust.item() != b.thrust.item())
    return np.asarray((a.q_w_flu_wxyz != b.q_w_flu_wxyz).any(axis=-1) | (a.thrust != b.thrust))


def same_setpoint(a: AttitudeThrust, b: AttitudeThrust) -> bool:
    """Return True if all are equal to the last bit and need not be sent again."""
    return not changed(a, b).any()
