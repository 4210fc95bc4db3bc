"""Pipeline of a flight: law, conversion and limits in compiled code where they can be, with the same numbers.

Python flies the first cycle of a law, the cycles in which another law's command fades, laws that are not compiled, and
what the guard does not let pass as it is.
"""

import ctypes
from functools import cached_property
from struct import Struct

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import pointers, quick_library
from companion.control.compiled.cycle import Held, Law, example_law, law_of
from companion.control.compiled_law import with_room
from companion.control.controller import ControlInput, Controller, ControlOutput
from companion.control.disturbance import Disturbance
from companion.control.etnn import EtnnMemory
from companion.control.pipeline import ControlPipeline, PipelineOutput
from companion.core.types import Array, AttitudeThrust, Reference, Scalar, VehicleState
from companion.core.values import value
from companion.geometry.attitude import ThrustModel
from companion.guard.guard import Guard
from companion.guard.limits import LimitedSetpoint, Limits

_NOTHING = np.zeros(3)
_FLAG = _NOT, _YES = np.array(False), np.array(True)
_GIVEN = Struct("34d")
_CUT, _IS_NEW, _WANTED = slice(5, 9), 9, slice(10, 15)
_SENT, _ACCEL, _EVENT = slice(15, 18), slice(18, 21), slice(21, 22)
"""Places in the output of a cycle, after the setpoint: `cycle.Commanded`."""
_NAMES = ("x1", "y1", "y2", "alpha1", "alpha2", "u_bar", "chi", "xi", "iota1", "iota2", "kappa", "push")
_SIGNALS = {name: slice(22 + 3 * index, 25 + 3 * index) for index, name in enumerate(_NAMES[:-2])}
_SIGNALS |= {"kappa": slice(52, 53), "push": slice(53, 56)}
_V0, _V1, _SETPOINT = slice(12, 28), slice(28, 43), slice(98, 103)
"""Places of the network's weights and of the law's setpoint in the memory: `cycle.Held`."""


@value
class Given:
    """Inputs of one cycle beside the vehicle's state."""

    age_s: float
    ahead: Reference
    last: AttitudeThrust
    dt_s: float
    known_accel_w_mps2: Array


class CompiledCycle:
    """One law's cycles in compiled code, on vectors that stay where they are."""

    def __init__(self, law: Law, code: ctypes.CDLL) -> None:
        self._code = code
        sizes = (ctypes.c_int * 6).in_dll(code, "pilot_sizes")
        self._memory, self._given, self._law, known, self._out, self._halfway = (np.empty(size) for size in sizes)
        self._f_hat, self._known = np.empty(3), known
        self._law[:] = flat(law, example_law())[0]
        vectors = (self._memory, self._given, self._law, known, self._out, self._halfway, self._f_hat)
        self._pointers = pointers(vectors)
        code.pilot_prepare(self._pointers)

    def load(self, held: Held) -> None:
        """Take the pipeline's memory."""
        self._memory[:] = flat(held, held)[0]

    def setpoint(self) -> AttitudeThrust:
        """Return the law's setpoint, before the limits."""
        return _setpoint(self._memory[_SETPOINT].copy())

    def kept(self) -> tuple[float, Array, Disturbance]:
        """Return what outlasts a law: the last heading (rad), the arms' part of the setpoint, and the disturbance."""
        kept = self._memory[_SETPOINT.stop :].copy()
        accel, velocity, acting, sent = kept[4:].reshape(4, 3)
        return kept.item(0), kept[1:4], Disturbance(accel, velocity, acting, sent)

    def decide(self, vehicle: VehicleState, given: Given) -> Array:
        """Run the first half of a cycle; return its output."""
        ahead, last = given.ahead, given.last
        numbers = (
            *(0.0, *vehicle.position_w_m.tolist(), *vehicle.velocity_w_mps.tolist()),
            *(*vehicle.q_w_flu_wxyz.tolist(), *vehicle.rate_flu_radps.tolist(), given.age_s),
            *(*ahead.position_w_m.tolist(), *ahead.velocity_w_mps.tolist(), *ahead.acceleration_w_mps2.tolist()),
            *(ahead.yaw_rad, *last.q_w_flu_wxyz.tolist(), last.thrust, given.dt_s),
            *given.known_accel_w_mps2.tolist(),
        )
        _GIVEN.pack_into(self._given.data, 0, *numbers)
        self._code.pilot_decide(self._pointers)
        return self._out.copy()

    def settle(self, out: Array) -> dict[str, Array]:
        """Run the second half; return all internal values of the cycle, whose output this was."""
        weights = self._memory[: _V1.stop].copy()
        self._code.pilot_settle(self._pointers)
        signals = {name: out[part] for name, part in _SIGNALS.items()}
        late = {"f_hat": self._f_hat.copy(), "v0": weights[_V0].reshape(4, 4), "v1": weights[_V1].reshape(5, 3)}
        return signals | late


def _setpoint(numbers: Array) -> AttitudeThrust:
    return AttitudeThrust(numbers[:4], numbers[4:5].reshape(()))


class CompiledOutput(PipelineOutput):
    """Output of a compiled cycle; what only the record needs is put together when it is asked for."""

    def __init__(self, limited: LimitedSetpoint, out: Array, vehicle: VehicleState, given: Given) -> None:
        self._out, self._vehicle, self._given = out, vehicle, given
        vars(self).update(limited=limited, reference=given.ahead, begun=False, is_new=out.item(_IS_NEW) != 0.0)

    @cached_property
    def law_output(self) -> ControlOutput:
        """Output of the law."""
        return ControlOutput(self._out[_ACCEL], self._out[_EVENT], {})

    @cached_property
    def given(self) -> ControlInput:
        """Inputs of the law."""
        vehicle, given = self._vehicle, self._given
        return ControlInput(
            position_w_m=vehicle.position_w_m,
            velocity_w_mps=vehicle.velocity_w_mps,
            q_w_flu_wxyz=vehicle.q_w_flu_wxyz,
            rate_flu_radps=vehicle.rate_flu_radps,
            age_s=given.age_s,
            reference=given.ahead,
            sent_accel_w_mps2=self._out[_SENT],
            dt_s=given.dt_s,
            known_accel_w_mps2=given.known_accel_w_mps2,
        )


class FlightPipeline(ControlPipeline):
    """Pipeline of one vehicle in flight."""

    def __init__(self, controller: Controller, model: ThrustModel, limits: Limits, guard: Guard | None = None) -> None:
        self._cycle: CompiledCycle | None = None
        self._flying = False
        """The compiled code has the memory, else Python."""
        self._out: Array | None = None
        """Output of a cycle that is not settled yet."""
        super().__init__(controller, model, limits, guard=guard)

    def _take(self, controller: Controller) -> None:
        super()._take(controller)
        law, code = law_of(controller, self._model, self._limits), quick_library()
        self._cycle = None if law is None or code is None else CompiledCycle(law, code)

    def forget(self) -> None:
        """Reset the law, so that the next `fly` begins with nothing learnt, as at lift-off."""
        self._flying, self._out = False, None
        super().forget()

    def switch(self, controller: Controller) -> None:
        """Fly another law from the next cycle on; see `ControlPipeline.switch`."""
        self.settle()
        if self._flying and self._cycle is not None:
            self._law_setpoint = self._cycle.setpoint()
            self._yaw_rad, self._sent_arm_accel_w_mps2, self._disturbance = self._cycle.kept()
        self._flying = False
        super().switch(controller)

    def settle(self) -> dict[str, Array]:
        """Run the second half of the law's cycle; see `ControlPipeline.settle`."""
        if self._out is None or self._cycle is None:
            return super().settle()
        out, self._out = self._out, None
        return self._cycle.settle(out)

    def fly(
        self,
        vehicle: VehicleState,
        age_s: Scalar,
        ahead: Reference,
        sent: AttitudeThrust,
        dt_s: float,
        known_accel_w_mps2: Array = _NOTHING,
    ) -> PipelineOutput:
        """Run one cycle; see `ControlPipeline.fly`."""
        self.settle()
        cycle = self._cycle
        if cycle is None or not (self._flying or self._load(cycle)):
            return super().fly(vehicle, age_s, ahead, sent, dt_s, known_accel_w_mps2)
        given = Given(float(age_s), ahead, sent, dt_s, known_accel_w_mps2)
        self._out = out = cycle.decide(vehicle, given)
        return CompiledOutput(self._limited(cycle, vehicle, given, out), out, vehicle, given)

    def _load(self, cycle: CompiledCycle) -> bool:
        """Give the compiled code Python's memory; return False while that is still to begin, or takes over."""
        memory, setpoint, disturbance = self._memory, self._law_setpoint, self._disturbance
        if memory is None or setpoint is None or disturbance is None or self._switching is not None:
            return False
        assert isinstance(memory, EtnnMemory)
        arms = self._sent_arm_accel_w_mps2
        cycle.load(Held(with_room(memory), setpoint, float(self._yaw_rad), arms, disturbance))
        self._flying = True
        return True

    def _limited(self, cycle: CompiledCycle, vehicle: VehicleState, given: Given, out: Array) -> LimitedSetpoint:
        """Return the compiled setpoint where the guard only limits it, else what the guard makes of the law's."""
        numbers, last, age_s, dt_s = out.tolist(), given.last, given.age_s, given.dt_s
        if self._guard is not None and not self._guard.passes(numbers[_WANTED], last, vehicle, age_s, dt_s):
            return self._guard.check(cycle.setpoint(), last, vehicle, age_s, dt_s)
        not_finite, tilt, thrust, slew = numbers[_CUT]
        return LimitedSetpoint(
            setpoint=_setpoint(out),
            not_finite=_FLAG[not_finite != 0.0],
            tilt_cut=_FLAG[tilt != 0.0],
            thrust_cut=_FLAG[thrust != 0.0],
            slew_cut=_FLAG[slew != 0.0],
            age_cut=_NOT,
            fence_cut=_NOT,
            separation_cut=_NOT,
        )
