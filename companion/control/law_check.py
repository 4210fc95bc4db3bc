"""Check that an object is a control law: its methods, and a few cycles run on the ground. No I/O, no clock.

A law that passes runs in the flight loop and in batches (docs/own-law.md); it does not show whether it flies well.
"""

import copy
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from companion.control.controller import (
    ControlInput,
    Controller,
    ControlOutput,
    Decided,
    Law,
    Memory,
    SeededLaw,
    TwoHalves,
)
from companion.core.interfaces import ConfigError
from companion.core.types import Array, Reference

_METHODS = {"initial": "initial(self, first), the memory at lift-off", "step": "step(self, memory, now), one cycle"}
_CYCLES = 3
_POSITION_M = np.array([[0.10, -0.07, 1.15], [-0.21, 0.04, 1.31]])
_VELOCITY_MPS = np.array([[0.12, 0.05, -0.08], [-0.03, 0.17, 0.06]])
_Q = np.array([[0.96, 0.08, 0.12, 0.24], [1.0, 0.0, 0.0, 0.0]])
_RATE_RADPS = np.array([[0.3, -0.2, 0.1], [-0.1, 0.2, 0.0]])
_AGE_S = np.array([[0.012], [0.016]])
_SENT_MPS2 = np.array([[0.3, -0.1, 0.2], [-0.4, 0.6, -0.3]])
_TARGET_M, _TARGET_MPS, _TARGET_MPS2 = np.array([0.0, 0.0, 1.2]), np.array([0.3, 0.2, 0.0]), np.array([0.1, -0.2, 0.0])
_KNOWN_MPS2 = np.array([0.02, -0.05, 0.03])
_DISTURBANCE_MPS2 = np.array([0.6, -0.4, 0.1])

Result = TypeVar("Result")


@dataclass(frozen=True)
class LawFile:
    """Origin of a law: the Python file, and the name in it. Every error message begins with both."""

    path: Path
    name: str

    def wrong(self, why: str) -> ConfigError:
        """Return the error to raise; `why` follows the name."""
        return ConfigError(f"{self.path}: {self.name}{why}")

    def call(self, what: str, function: Callable[..., Result], *arguments: object) -> Result:
        """Return `function(*arguments)`; if it raises, ConfigError with the exception and its line in the file."""
        try:
            return function(*arguments)
        except Exception as error:
            raise self.wrong(f"{what} raised {raised(error, self.path)}") from error


@contextmanager
def in_flight(path: Path | None) -> Iterator[None]:
    """Raise ConfigError for exceptions of the law in the Python file at `path` during a virtual flight, as at loading.

    None is a built-in law. Exceptions that did not pass through that file are raised unchanged: no user can fix them.
    """
    try:
        yield
    except Exception as error:
        if path is None or not _lines(error, path):
            raise
        raise ConfigError(f"{path}: raised in flight: {raised(error, path)}") from error


def _lines(error: BaseException, path: Path) -> list[int | None]:
    """Return the lines of the file at `path` that an exception passed through."""
    return [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]


def raised(error: BaseException, path: Path) -> str:
    """Return an exception as one line of text, with the line of the file at `path` that it came from."""
    if isinstance(error, SyntaxError):
        where = "" if error.filename == str(path) else f"{error.filename}, "
        return f"{type(error).__name__}: {error.msg} ({where}line {error.lineno})"
    lines = _lines(error, path)
    said = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{said} (line {lines[-1]})" if lines else said


def check_law(law: object, file: LawFile, period_s: float) -> Controller:
    """Return the law itself if it has the methods of a Controller and runs three cycles, for one vehicle and for two.

    Raises ConfigError with one sentence that says what is wrong and what is expected.
    """
    for method, meaning in _METHODS.items():
        if not callable(getattr(law, method, None)):
            raise file.wrong(f" has no method {method}: a law has {meaning}")
    preview = file.call(".preview_s", lambda: getattr(law, "preview_s", None))
    if isinstance(preview, bool) or not isinstance(preview, float | int) or not 0.0 <= preview < np.inf:
        raise file.wrong(f".preview_s is {preview!r}: must be a property that gives seconds, 0.0 or more")
    checked = cast(Controller, law)
    alone = [_run_cycles(checked, file, row, period_s) for row in range(2)]
    together = _run_cycles(checked, file, slice(None), period_s)
    for row, outputs in enumerate(alone):
        for single, batch in zip(outputs, together, strict=True):
            _compare(single, batch, row, file)
    return checked


def _test_input(rows: int | slice, cycle: int, period_s: float) -> ControlInput:
    """Return the input of a vehicle near its reference, shapes (3,), or of two, (2, 3); arrays are read-only.

    Two vehicles share one reference (3,) in the first cycle and have one each, (2, 3), afterwards: both occur.
    """
    target = _TARGET_M if isinstance(rows, int) or cycle == 0 else np.tile(_TARGET_M, (2, 1))
    reference = Reference(_read_only(target), _read_only(_TARGET_MPS), _read_only(_TARGET_MPS2), 0.1)
    return ControlInput(
        position_w_m=_read_only((_POSITION_M + cycle * period_s * _VELOCITY_MPS)[rows]),
        velocity_w_mps=_read_only(_VELOCITY_MPS[rows]),
        q_w_flu_wxyz=_read_only(_Q[rows]),
        rate_flu_radps=_read_only(_RATE_RADPS[rows]),
        age_s=float(_AGE_S[rows, 0]) if isinstance(rows, int) else _read_only(_AGE_S),
        reference=reference,
        sent_accel_w_mps2=_read_only(_SENT_MPS2[rows]),
        dt_s=period_s,
        known_accel_w_mps2=_read_only(_KNOWN_MPS2),
    )


def _read_only(values: Array) -> Array:
    array = np.array(values)
    array.setflags(write=False)
    return array


def _run_cycles(law: Law[Memory], file: LawFile, rows: int | slice, period_s: float) -> list[ControlOutput]:
    """Return the outputs of a few cycles, each run twice from the same memory, which must not differ."""
    inputs = [_test_input(rows, cycle, period_s) for cycle in range(_CYCLES)]
    shape = inputs[0].position_w_m.shape
    of = f" with positions of shape {shape}"
    memory = file.call(f".initial{of}", law.initial, inputs[0])
    memories, outputs = [], []
    for now in inputs:
        memories.append(memory)
        memory, output = _run_step(law, file, memory, now, of)
        outputs.append(output)
    for kept, now, first in zip(memories, inputs, outputs, strict=True):
        _, again = _run_step(law, file, kept, now, of)
        if not _same(first, again):
            raise file.wrong(
                ".step gave two answers to the same memory and input: it must give back a new memory instead of "
                "changing the old one in place, keep nothing in self, and draw no random numbers"
            )
    if isinstance(law, TwoHalves):
        _check_halves(law, file, memories[-1], inputs[-1], outputs[-1])
    if isinstance(law, SeededLaw):
        disturbance = _read_only(np.broadcast_to(_DISTURBANCE_MPS2, shape))
        memory = file.call(f".initial_with{of}", law.initial_with, inputs[0], disturbance)
        _run_step(law, file, memory, inputs[0], f" after .initial_with{of}")
    return outputs


def _run_step(
    law: Law[Memory], file: LawFile, memory: Memory, now: ControlInput, of: str
) -> tuple[Memory, ControlOutput]:
    answer: object = file.call(f".step{of}", law.step, memory, now)
    if not (isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], ControlOutput)):
        raise file.wrong(f".step returned {_kind_of(answer)}: must be (memory, ControlOutput)")
    _check_output(answer[1], now.position_w_m.shape[:-1], file, of)
    return answer[0], copy.deepcopy(answer[1])  # the law may reuse its arrays


def _check_output(output: ControlOutput, lead: tuple[int, ...], file: LawFile, of: str) -> None:
    _check_array("accel_w_mps2", output.accel_w_mps2, (*lead, 3), file, of)
    _check_array("event", output.event, (*lead, 1), file, of)
    if not np.isin(output.event, (0.0, 1.0)).all():
        raise file.wrong(f".step{of} gave event = {output.event.tolist()}: must be 1 where to send and 0 elsewhere")
    if not isinstance(output.signals, dict):
        raise file.wrong(f".step gave {_kind_of(output.signals)} as signals: must be a dict of arrays, {{}} for none")
    for name, signal in output.signals.items():
        own = np.shape(signal)[len(lead) :] or (1,)
        _check_array(f"signals[{name!r}]", signal, (*lead, *own), file, of)


def _check_array(name: str, value: object, shape: tuple[int, ...], file: LawFile, of: str) -> None:
    if not isinstance(value, np.ndarray):
        raise file.wrong(f".step{of} gave {_kind_of(value)} as {name}: must be an array of shape {shape}")
    if value.shape != shape:
        raise file.wrong(f".step{of} gave {name} of shape {value.shape}: must be {shape}")
    if value.dtype.kind not in "fiub" or not np.isfinite(value).all():
        raise file.wrong(f".step{of} gave {name} = {value.tolist()}: must be finite numbers")


def _check_halves(
    law: TwoHalves[Memory, Decided], file: LawFile, memory: Memory, now: ControlInput, whole: ControlOutput
) -> None:
    decided, output = file.call(".decide", law.decide, memory, now)
    settled: object = file.call(".settle", law.settle, decided)
    if not (isinstance(settled, tuple) and len(settled) == 2 and isinstance(settled[1], dict)):
        raise file.wrong(f".settle returned {_kind_of(settled)}: must be (memory, dict of arrays)")
    if not _same(whole, output):
        raise file.wrong(".decide gave another command than .step: step must be decide followed by settle")


def _same(a: ControlOutput, b: ControlOutput) -> bool:
    return np.array_equal(a.accel_w_mps2, b.accel_w_mps2) and np.array_equal(a.event, b.event)


def _compare(alone: ControlOutput, batch: ControlOutput, row: int, file: LawFile) -> None:
    """Raise ConfigError if a vehicle of a batch gets another command than alone."""
    if not np.allclose(alone.accel_w_mps2, batch.accel_w_mps2[row], rtol=1e-9, atol=1e-9):
        raise file.wrong(
            f".step commands {batch.accel_w_mps2[row].tolist()} m/s^2 to a vehicle in a batch of two and "
            f"{alone.accel_w_mps2.tolist()} to the same vehicle alone: sums and norms must go along the last axis only"
        )
    for name, signal in alone.signals.items():
        shape, of = (2, *signal.shape), " with positions of shape (2, 3)"
        _check_array(f"signals[{name!r}]", batch.signals.get(name), shape, file, of)


def _kind_of(value: object) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
