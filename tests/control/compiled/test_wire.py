"""The compiled correction of the horizon is the correction: every number the same, whatever both attitudes do."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.compiled.library import library
from companion.control.compiled.wire import CompiledWire, FlightWire
from companion.control.horizon_correction import HorizonInput, HorizonRules
from companion.control.wire_setpoint import Wire, WireSetpoint
from companion.core.types import Array, AttitudeThrust
from companion.geometry.frames import quat_from_rotation_vector, quat_multiply
from companion.guard.limits import Limits

compiled = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
LIMITS = Limits(max_tilt_rad=0.3, max_turn_radps=2.0)
RULES = HorizonRules(time_constant_s=0.2, cap_rad=0.06, resend_rad=0.01)
LEVEL = AttitudeThrust(np.array([1.0, 0.0, 0.0, 0.0]), np.array(0.5))


def turned(rng: np.random.Generator, size_rad: float) -> Array:
    return quat_from_rotation_vector(size_rad * rng.normal(size=3))


def seen(rng: np.random.Generator, apart_rad: float) -> HorizonInput:
    ours = quat_multiply(turned(rng, 0.2), quat_from_rotation_vector(np.array((0.0, 0.0, rng.normal()))))
    return HorizonInput(
        q_w_flu_wxyz=ours,
        rate_flu_radps=rng.normal(size=3),
        age_s=0.01 + 0.01 * rng.random(),
        autopilot_q_w_flu_wxyz=quat_multiply(ours, turned(rng, apart_rad)),
        autopilot_age_s=0.02 * rng.random(),
        trusted=True,
        flying=True,
    )


def same(wire: Wire, wanted: Wire) -> None:
    assert [field.name for field in fields(wire)] == [field.name for field in fields(wanted)]
    for a, b in ((wire.setpoint, wanted.setpoint), (wire.last, wanted.last)):
        np.testing.assert_array_equal(a.q_w_flu_wxyz, b.q_w_flu_wxyz)
        assert (a.thrust.shape, a.thrust.item()) == (b.thrust.shape, b.thrust.item())
    assert vars(wire.horizon) == vars(wanted.horizon)
    assert wire.horizon.off_rad == wanted.horizon.off_rad
    assert (wire.is_new, wire.inputs, wire.dt_s, wire.begun) == (
        wanted.is_new,
        wanted.inputs,
        wanted.dt_s,
        wanted.begun,
    )


TROUBLES = ("no attitude", "silent", "distrusted", "standing", "far apart", "reset")


@given(
    seed=st.integers(0, 2**32 - 1),
    apart_rad=st.sampled_from((0.001, 0.03, 0.2)),
    troubles=st.dictionaries(st.integers(0, 119), st.sampled_from(TROUBLES), max_size=12),
    enabled=st.sampled_from((True, True, False)),
)
@settings(max_examples=20, deadline=None)
def test_every_number_is_the_same(seed: int, apart_rad: float, troubles: dict[int, str], enabled: bool) -> None:
    rng, rules = np.random.default_rng(seed), replace(RULES, enabled=enabled)
    both = FlightWire(rules, LIMITS), WireSetpoint(rules, LIMITS)
    setpoint = last = LEVEL
    for cycle in range(120):
        is_new, dt_s = rng.random() < 0.1, 0.008 + 0.004 * rng.random()
        if is_new:
            setpoint = AttitudeThrust(turned(rng, 0.2), np.array(0.5 + 0.1 * rng.normal()))
        inputs = seen(rng, apart_rad)
        match troubles.get(cycle):
            case "no attitude":
                inputs = replace(inputs, autopilot_q_w_flu_wxyz=np.full(4, math.nan))
            case "silent":
                inputs = replace(inputs, autopilot_age_s=math.inf)
            case "distrusted":
                inputs = replace(inputs, trusted=False)
            case "standing":
                inputs = replace(inputs, flying=False)
            case "far apart":
                inputs = replace(inputs, autopilot_q_w_flu_wxyz=turned(rng, 1.0))
            case "reset":
                for one in both:
                    one.reset()
        wire, wanted = (one.put(setpoint, is_new, last, inputs, dt_s) for one in both)
        same(wire, wanted)
        last = wire.setpoint


@compiled
def test_what_is_enabled_is_compiled_and_stays_as_it_was() -> None:
    rng = np.random.default_rng(1)
    both = FlightWire(RULES, LIMITS), WireSetpoint(RULES, LIMITS)
    put = [[one.put(LEVEL, False, LEVEL, inputs, 0.01) for one in both] for inputs in (seen(rng, 0.03),) * 90]
    assert all(isinstance(fast, CompiledWire) for fast, _ in put)
    for fast, wanted in put:
        same(fast, wanted)
    off = FlightWire(replace(RULES, enabled=False), LIMITS)
    assert not isinstance(off.put(LEVEL, False, LEVEL, seen(rng, 0.03), 0.01), CompiledWire)
