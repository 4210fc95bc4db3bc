"""Laws of users and of other authors in compiled code, for many vehicles in virtual time; in flight they stay Python.

The law's own Python is traced in the place of ET-NN in the compiled loop, with its gains as they are. What cannot be
traced flies in Python, as before: a branch on a number, a function of numpy that rounds as the processor does. Before
compiled code is used it flies some cycles beside the Python; it must give the same numbers to the last bit.
"""

import ctypes
import inspect
import logging
from pathlib import Path

import numpy as np

from companion.compiled.leaves import flat
from companion.compiled.library import SOURCE
from companion.compiled.own_code import own_code
from companion.control.compiled.cycle import Held, Pipeline
from companion.control.controller import Controller
from companion.control.law_check import raised
from companion.control.network import NetworkState
from companion.core.types import Array, AttitudeThrust, Reference, VehicleState
from companion.core.values import value
from companion.geometry.attitude import ThrustModel
from companion.guard.limits import Limits
from companion.simulation import traces
from companion.simulation.traces import Flown, Given

WORTH_COMPILING = 50
"""Vehicles from which a law is compiled: it takes a second or two, once for each version of law, gains and vehicle."""
_CYCLES = 40
"""Cycles that compiled code and Python fly beside each other before it is used."""
_PERIOD_S = 0.01
_ENTRY = """
void once(double *held, const double *given, const double *law, const double *period_s, double *setpoint,
          double *command)
{
    double known[fly_known_size + 1];
    fly_known(law, period_s, known);
    fly(held, given, law, period_s, known, held, setpoint, command);
}
"""
log = logging.getLogger(__name__)
_found: list[tuple[Controller, ctypes.CDLL | str]] = []
"""Laws asked for lately; they may have no hash."""


@value(kw_only=True)
class Surroundings:
    """Parameters of what comes after a law: conversion and limits."""

    model: ThrustModel
    limits: Limits


SURROUNDINGS = Surroundings(model=ThrustModel(), limits=Limits())
"""The form of these numbers."""


def code_of(law: Controller) -> ctypes.CDLL | str:
    """Return compiled code that flies a law as flight.c does; why there is none, if so."""
    for known, code in _found:
        if known is law:
            return code
    code = _code_of(law)
    name = type(law).__name__
    if isinstance(code, str):
        log.info("%s flies in Python, slower than compiled: %s", name, code)
    else:
        log.info("%s flies compiled", name)
    _found.append((law, code))
    del _found[:-4]
    return code


def _code_of(law: Controller) -> ctypes.CDLL | str:
    path = Path(inspect.unwrap(law.step).__code__.co_filename)
    try:
        flown = _flown(law)
        held = _begun(flown, _given(np.random.default_rng(0)))
        strange = _strange(held.law)
        if strange is not None:
            return f"its memory holds a {type(strange).__name__}: only floats and arrays of floats can be traced"
        functions = traces.functions(flown)
    except Exception as error:  # whatever a user's law does, it flies in Python
        return raised(error, path)
    fly = next(function for function in functions if function.name == "fly")
    if fly.takes["memory"] != fly.returns["after"]:
        return "its memory has another form after a cycle"
    source = SOURCE.read_text(encoding="utf-8").replace('#include "traced.c"', traces.source(functions))
    source = source.replace('#include "flight.h"', SOURCE.with_suffix(".h").read_text(encoding="utf-8"))
    code = own_code(source + _ENTRY)
    return code if isinstance(code, str) or _same(code, flown) else "compiled it gives other numbers than Python"


def _flown(law: Controller) -> Flown:
    class Around(Surroundings):
        def pipeline(self) -> Pipeline:
            return Pipeline(law, self.model, self.limits)

    return Around(**vars(SURROUNDINGS))


def _begun(flown: Flown, given: Given) -> Held:
    begun = traces.begin_law(given, flown, _PERIOD_S, NetworkState(np.zeros(0), np.zeros(0)))["after"]
    assert isinstance(begun, Held)
    return begun


def _strange(value: object) -> object | None:
    """Return a part of a law's memory that is no number: the trace would take it for one that never changes."""
    if isinstance(value, tuple):
        return next((found for part in value if (found := _strange(part)) is not None), None)
    if isinstance(value, np.ndarray):
        return None if value.dtype == np.float64 else value.dtype.type(0)
    if value is None or type(value) in (float, np.float64):
        return None
    fields = getattr(value, "__dataclass_fields__", None)
    return value if fields is None else _strange(tuple(getattr(value, name) for name in fields))


def _same(code: ctypes.CDLL, flown: Flown) -> bool:
    """Return True if compiled code and Python give the same numbers from the same random inputs."""
    rng = np.random.default_rng(0)
    given = _given(rng)
    held = _begun(flown, given)
    law, example = _vector(flat(flown, flown)), held
    compiled, period_s = _vector(flat(held, example)), ctypes.c_double(_PERIOD_S)
    setpoint, command = (ctypes.c_double * 5)(), (ctypes.c_double * 4)()
    for _ in range(_CYCLES):
        result = traces.fly(held, given, flown, _PERIOD_S)
        code.once(compiled, _vector(flat(given, given)), law, ctypes.byref(period_s), setpoint, command)
        held = result["after"]  # type: ignore[assignment]
        expected = np.concatenate([flat(held, example)[0], _numbers(result["setpoint"]), _numbers(result["command"])])
        if not np.array_equal(expected, np.array([*compiled, *setpoint, *command]), equal_nan=True):
            return False
        given = _given(rng)
    return True


def _numbers(value: object) -> Array:
    return np.asarray(flat(value, value)[0])


def _vector(row: Array) -> "ctypes.Array[ctypes.c_double]":
    return (ctypes.c_double * row.size)(*row.ravel().tolist())


def _given(rng: np.random.Generator) -> Given:
    """Return the inputs of a vehicle somewhere near its reference."""
    q, sent = (np.array((1.0, 0.0, 0.0, 0.0)) + rng.normal(0.0, 0.1, 4) for _ in range(2))
    p, v, a = (rng.normal(0.0, 0.5, 3) for _ in range(3))
    return Given(
        state=VehicleState(
            0.0, p + rng.normal(0.0, 0.2, 3), v + rng.normal(0.0, 0.3, 3), q / np.sqrt(q @ q), rng.normal(0.0, 0.5, 3)
        ),
        age_s=float(rng.uniform(0.0, 0.03)),
        ahead=Reference(p, v, a, float(rng.normal())),
        last=AttitudeThrust(sent / np.sqrt(sent @ sent), np.array(rng.uniform(0.3, 0.7))),
        known_accel_b_mps2=rng.normal(0.0, 0.2, 3),
    )
