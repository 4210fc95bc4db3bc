"""ET-NN law of one vehicle in compiled code: the same numbers to the last bit, with less memory touched."""

import ctypes

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import library
from companion.control.controller import ControlInput, Controller, ControlOutput
from companion.control.etnn import Etnn, EtnnMemory
from companion.control.gains import EtnnGains
from companion.control.law_numbers import NO_LOOKAHEAD, lookahead_of, with_room
from companion.core.types import Array

_NAMES = ("x1", "y1", "y2", "alpha1", "alpha2", "u_bar", "chi", "xi", "iota1", "iota2", "kappa", "push")
_SIGNALS = {name: slice(4 + 3 * index, 7 + 3 * index) for index, name in enumerate(_NAMES[:-2])}
_SIGNALS |= {"kappa": slice(34, 35), "push": slice(35, 38)}
"""Internal values of a cycle in the compiled output, after the command and the event."""
_OUTPUT = 38
_V0, _V1 = slice(12, 28), slice(28, 43)
"""Weights of the network in the memory."""


class CompiledLaw:
    """ET-NN law for one vehicle in flight; its memory is one vector, which each half of a cycle replaces."""

    def __init__(self, law: Etnn, numbers: tuple[Array, Array], code: ctypes.CDLL) -> None:
        self._law, self._code, self._numbers = law, code, numbers

    @property
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference, s."""
        return self._law.preview_s

    def initial(self, first: ControlInput) -> Array:
        """Return the memory at lift-off."""
        return _vector(self._law.initial(first))

    def initial_with(self, now: ControlInput, known_disturbance_w_mps2: Array) -> Array:
        """Return the memory for a vehicle in flight; see `Etnn.initial_with`."""
        return _vector(self._law.initial_with(now, known_disturbance_w_mps2))

    def step(self, memory: Array, now: ControlInput) -> tuple[Array, ControlOutput]:
        """Run one cycle."""
        decided, output = self.decide(memory, now)
        after, more = self.settle(decided)
        return after, ControlOutput(output.accel_w_mps2, output.event, output.signals | more)

    def decide(self, memory: Array, now: ControlInput) -> tuple[tuple[Array, Array], ControlOutput]:
        """Run the first half of a cycle."""
        after, output, given = memory.copy(), np.empty(_OUTPUT), _given(now)
        self._code.law_decide(*map(_place, (after, given, *self._numbers, output)))
        signals = {name: output[part] for name, part in _SIGNALS.items()}
        halfway = np.concatenate((signals["alpha1"], signals["y2"], now.reference.velocity_w_mps, (now.dt_s,)))
        return (after, halfway), ControlOutput(output[0:3], output[3:4], signals)

    def settle(self, decided: tuple[Array, Array]) -> tuple[Array, dict[str, Array]]:
        """Run the second half of a cycle."""
        before, halfway = decided
        after, f_hat = before.copy(), np.empty(3)
        self._code.law_settle(*map(_place, (after, halfway, self._numbers[0], f_hat)))
        return after, {"f_hat": f_hat, "v0": before[_V0].reshape(4, 4), "v1": before[_V1].reshape(5, 3)}


def compiled_law(law: Controller) -> Controller:
    """Return the compiled twin of a law for one vehicle in flight; the law itself where there is none."""
    code = library()
    if code is None or type(law) is not Etnn or law.predictor is None or law.gains.hidden != EtnnGains().hidden:
        return law
    lookahead = lookahead_of(law.predictor)
    if lookahead is None:
        return law
    return CompiledLaw(law, (flat(law.gains, law.gains)[0], flat(lookahead, NO_LOOKAHEAD)[0]), code)


def _vector(memory: EtnnMemory) -> Array:
    roomy = with_room(memory)
    vector: Array = flat(roomy, roomy)[0]
    return vector


def _given(now: ControlInput) -> Array:
    """Return the inputs of a cycle in the order of ControlInput's fields."""
    r = now.reference
    return np.array(
        (
            *(*now.position_w_m.tolist(), *now.velocity_w_mps.tolist()),
            *(*now.q_w_flu_wxyz.tolist(), *now.rate_flu_radps.tolist(), now.age_s),
            *(*r.position_w_m.tolist(), *r.velocity_w_mps.tolist(), *r.acceleration_w_mps2.tolist(), r.yaw_rad),
            *(*now.sent_accel_w_mps2.tolist(), now.dt_s, *now.known_accel_w_mps2.tolist()),
        )
    )


def _place(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
