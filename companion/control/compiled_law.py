"""ET-NN law in compiled code: its predictor as numbers of a fixed count, and the law of many vehicles."""

import ctypes
from dataclasses import replace

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import library
from companion.control.controller import ControlInput, Controller, ControlOutput, VehicleModel
from companion.control.delay_predictor import Predictor, Weights
from companion.control.etnn import Etnn, EtnnMemory
from companion.control.gains import EtnnGains
from companion.core.types import Array, Reference, Scalar
from companion.core.values import value
from companion.geometry.array_math import where

COMMANDS = 10
"""Most commands that a compiled predictor remembers; one that remembers fewer has weights of 0 for the older ones."""


@value(kw_only=True)
class Lookahead:
    """Predictor as numbers: its weights for COMMANDS commands, (2, 3, COMMANDS + 2), and how many of them count."""

    vehicle: VehicleModel
    horizon_s: Scalar
    drives: Array
    thrust_share: float
    observer_radps: Scalar
    observer_trend: Scalar
    commands: float


NO_LOOKAHEAD = Lookahead(
    vehicle=VehicleModel(),
    horizon_s=0.0,
    drives=np.zeros((2, 3, COMMANDS + 2)),
    thrust_share=0.0,
    observer_radps=0.0,
    observer_trend=0.0,
    commands=1.0,
)
"""The shapes of these numbers."""


def lookahead_of(law: Controller) -> Lookahead | None:
    """Return the prediction of an ET-NN law as numbers.

    None for a law that is not compiled: another one, one of another size, or without a prediction, or whose prediction
    remembers more commands than there is room for.
    """
    if type(law) is not Etnn or law.predictor is None or law.gains.hidden != EtnnGains().hidden:
        return None
    predictor, weights = law.predictor, law.predictor.weights
    commands = weights.drives.shape[-1] - 2
    if commands > COMMANDS:
        return None
    return Lookahead(
        vehicle=predictor.vehicle,
        horizon_s=weights.horizon_s,
        drives=_with_room(weights.drives),
        thrust_share=predictor.thrust_share,
        observer_radps=predictor.observer_radps,
        observer_trend=predictor.observer_trend,
        commands=float(commands),
    )


def with_room(memory: EtnnMemory) -> EtnnMemory:
    """Return a memory whose predictor has room for COMMANDS commands."""
    assert memory.predictor is not None
    return replace(memory, predictor=replace(memory.predictor, drives=_with_room(memory.predictor.drives)))


def _with_room(drives: Array) -> Array:
    older = np.zeros((*drives.shape[:-1], COMMANDS + 2 - drives.shape[-1]))
    return np.concatenate((older, drives), axis=-1)


class NumberedPredictor(Predictor):
    """Predictor with room for COMMANDS commands."""

    def __init__(self, lookahead: Lookahead) -> None:
        weights = Weights(lookahead.horizon_s, lookahead.drives)
        self.__dict__.update(vars(lookahead) | {"weights": weights})

    def _oldest(self, drives: Array) -> Array:
        oldest, count = drives[..., COMMANDS - 1], self.__dict__["commands"]
        for commands in range(2, COMMANDS + 1):
            oldest = where(count == float(commands), drives[..., COMMANDS - commands], oldest)
        return oldest


_Memory, _Given, _Output = ctypes.c_double * 98, ctypes.c_double * 31, ctypes.c_double * 38


class CompiledLawOfMany:
    """ET-NN law for vehicles (B,), each flown as it would be alone; gives commands and events, no internal values."""

    def __init__(self, law: Etnn, gains: Array, lookahead: Array, code: ctypes.CDLL) -> None:
        self._law, self._code, self._numbers = law, code, (gains, lookahead)

    @property
    def preview_s(self) -> float:
        """Time ahead of now at which the law needs its reference, s."""
        return self._law.preview_s

    def initial(self, first: ControlInput) -> Array:
        """Return the memory at lift-off, (B, n)."""
        rows = _inputs(first, len(first.position_w_m))
        return np.array([_vector(self._law.initial(_alone(row))) for row in rows])

    def step(self, memory: Array, now: ControlInput) -> tuple[Array, ControlOutput]:
        """Run one cycle."""
        after, count = memory.copy(), len(memory)
        inputs = _inputs(now, count)
        output = np.empty((count, len(_Output())))
        arrays = (after, inputs, *self._numbers, output)
        self._code.law_step_each(ctypes.c_int64(count), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        return after, ControlOutput(output[:, 0:3], output[:, 3:4], {})


def _inputs(now: ControlInput, count: int) -> Array:
    """Return the inputs of a cycle as rows, (B, 31); what is the same for all is one number, or one vector."""
    rows, end, r = np.empty((count, len(_Given()))), 0, now.reference
    of_state = (now.position_w_m, now.velocity_w_mps, now.q_w_flu_wxyz, now.rate_flu_radps, now.age_s)
    of_reference = (r.position_w_m, r.velocity_w_mps, r.acceleration_w_mps2, np.reshape(r.yaw_rad, (-1, 1)))
    for column in (*of_state, *of_reference, now.sent_accel_w_mps2, now.dt_s, now.known_accel_w_mps2):
        begin, end = end, end + (np.shape(column)[-1] if np.ndim(column) else 1)
        rows[:, begin:end] = column
    return rows


def _alone(row: Array) -> ControlInput:
    """Return the inputs of one vehicle."""
    return ControlInput(
        position_w_m=row[0:3],
        velocity_w_mps=row[3:6],
        q_w_flu_wxyz=row[6:10],
        rate_flu_radps=row[10:13],
        age_s=float(row[13]),
        reference=Reference(row[14:17], row[17:20], row[20:23], float(row[23])),
        sent_accel_w_mps2=row[24:27],
        dt_s=float(row[27]),
        known_accel_w_mps2=row[28:31],
    )


def compiled_law_of_many(law: Controller) -> Controller:
    """Return the compiled twin of a law for vehicles (B,); the law itself where there is none."""
    code, lookahead = library(), lookahead_of(law)
    if code is None or lookahead is None:
        return law
    assert isinstance(law, Etnn)
    return CompiledLawOfMany(law, flat(law.gains, law.gains)[0], flat(lookahead, NO_LOOKAHEAD)[0], code)


def _vector(memory: EtnnMemory) -> ctypes.Array[ctypes.c_double]:
    roomy = with_room(memory)
    return _Memory(*flat(roomy, roomy)[0].tolist())
