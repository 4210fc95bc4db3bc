"""The compiled pipeline is the pipeline: every number the same, cycle after cycle, whatever vehicle and operator do."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.compiled.library import library
from companion.config.controller_config import load_controller
from companion.control.compiled.pipeline import CompiledOutput, FlightPipeline
from companion.control.controller import Controller, VehicleModel
from companion.control.etnn import Etnn
from companion.control.pipeline import ControlPipeline, PipelineOutput, idle_setpoint
from companion.core.types import Array, AttitudeThrust, Reference, VehicleState
from companion.geometry.attitude import ThrustModel
from companion.guard.geofence import Fence
from companion.guard.guard import AgeRange, Guard
from companion.guard.limits import Limits

compiled = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
LIMITS, MODEL = Limits(max_turn_radps=3.0), ThrustModel(curve=0.3)
GUARD = Guard(LIMITS, MODEL, Fence((-1.5, -1.2), (1.5, 1.2, 1.8)), AgeRange(0.05, 0.10))


def law_named(name: str) -> Controller:
    return load_controller(name, VehicleModel(), 0.01).law


def printed(law: Controller) -> Controller:
    """Neither regularised nor with a boundary layer."""
    assert isinstance(law, Etnn)
    as_printed = {"power_regularisation": 0.0, "boundary_layer_mps": 0.0}
    return replace(law, gains=law.gains.model_copy(update=as_printed))


class Pair:
    """The same pipeline twice, as it flies and in Python alone; what they give is compared."""

    def __init__(self, law: Controller, guard: Guard | None = GUARD) -> None:
        self.both = FlightPipeline(law, MODEL, LIMITS, guard), ControlPipeline(law, MODEL, LIMITS, guard=guard)
        self.sent = idle_setpoint(0.3, 0.5)

    def fly(self, *given: Any) -> PipelineOutput:
        outputs = [one.fly(*given) for one in self.both]
        same(*outputs)
        self.sent = outputs[0].limited.setpoint
        return outputs[0]

    def settle(self, output: PipelineOutput, other: PipelineOutput) -> None:
        fast, wanted = (one.settle() for one in self.both)
        fast, wanted = output.law_output.signals | fast, other.law_output.signals | wanted
        assert list(fast) == list(wanted), "the record has them in this order"
        for name, value in wanted.items():
            np.testing.assert_array_equal(fast[name], value, err_msg=name)


def same(one: PipelineOutput, other: PipelineOutput) -> None:
    for a, b in ((one.limited, other.limited), (one.given, other.given)):
        for field in fields(b):
            equal(getattr(a, field.name), getattr(b, field.name), field.name)
    assert (one.begun, bool(one.is_new)) == (other.begun, bool(other.is_new))
    equal(one.law_output.accel_w_mps2, other.law_output.accel_w_mps2, "command")
    equal(one.law_output.event, other.law_output.event, "event")
    equal(one.reference, other.reference, "reference")


def equal(value: Any, wanted: Any, name: str) -> None:
    if isinstance(wanted, AttitudeThrust | Reference):
        for field in fields(wanted):
            equal(getattr(value, field.name), getattr(wanted, field.name), field.name)
    elif isinstance(wanted, str):
        assert value == wanted
    else:
        np.testing.assert_array_equal(value, wanted, err_msg=name)


def cycles(count: int, rng: np.random.Generator, spread: float) -> Iterator[tuple[Any, ...]]:
    """Vehicles near a reference that moves, with all but the setpoint sent."""
    for _ in range(count):
        q = np.array((1.0, 0.0, 0.0, 0.0)) + 0.2 * rng.normal(size=4)
        place = rng.normal(size=3) * 0.5 + np.array((0.0, 0.0, 1.0))
        ahead = Reference(place, rng.normal(size=3) * 0.4, rng.normal(size=3), 0.1 * rng.normal())
        off: Array = place + spread * rng.normal(size=3)
        vehicle = VehicleState(0.0, off, rng.normal(size=3) * 0.5, q / np.sqrt(q @ q), rng.normal(size=3))
        age_s = rng.choice((0.01, 0.01 + 0.01 * rng.random(), 0.07, 0.2))
        yield vehicle, float(age_s), ahead, 0.008 + 0.004 * rng.random(), 0.1 * rng.normal(size=3)


@pytest.mark.parametrize("name", ["practical", "precise", "paper-repaired"])
@given(
    seed=st.integers(0, 2**32 - 1),
    spread=st.sampled_from((0.01, 0.3, 1.0)),
    as_printed=st.booleans(),
    guarded=st.booleans(),
    acts=st.dictionaries(st.integers(1, 29), st.sampled_from(("forget", "pid", "etnn", "itself", "unsettled"))),
)
@settings(max_examples=15, deadline=None)
def test_every_number_of_a_cycle_is_the_same(
    name: str, seed: int, spread: float, as_printed: bool, guarded: bool, acts: dict[int, str]
) -> None:
    law = printed(law_named(name)) if as_printed else law_named(name)
    pair, rng = Pair(law, GUARD if guarded else None), np.random.default_rng(seed)
    for index, (vehicle, age_s, ahead, dt_s, known) in enumerate(cycles(30, rng, spread)):
        act = acts.get(index)
        for one in pair.both:
            if act == "forget":
                one.forget()
            elif act in {"pid", "etnn", "itself"}:
                one.switch(law if act == "itself" else law_named(act))
        given = (vehicle, age_s, ahead, pair.sent, dt_s, known)
        fast, wanted = (one.fly(*given) for one in pair.both)
        same(fast, wanted)
        pair.sent = fast.limited.setpoint
        if act != "unsettled":
            pair.settle(fast, wanted)


@compiled
def test_only_the_first_cycle_of_a_law_is_flown_in_python() -> None:
    pair = Pair(law_named("practical"))
    flown = [
        pair.fly(vehicle, age_s, ahead, pair.sent, dt_s, known)
        for vehicle, age_s, ahead, dt_s, known in cycles(5, np.random.default_rng(1), 0.1)
    ]
    assert [isinstance(output, CompiledOutput) for output in flown] == [False, True, True, True, True]
    for one in pair.both:
        one.switch(law_named("pid"))
    vehicle, age_s, ahead, dt_s, known = next(cycles(1, np.random.default_rng(2), 0.1))
    assert not isinstance(pair.fly(vehicle, age_s, ahead, pair.sent, dt_s, known), CompiledOutput)


def test_what_a_cycle_gave_stays_as_it_was() -> None:
    pair, kept = Pair(law_named("practical")), []
    for vehicle, age_s, ahead, dt_s, known in cycles(6, np.random.default_rng(3), 0.1):
        given = (vehicle, age_s, ahead, pair.sent, dt_s, known)
        fast, wanted = (one.fly(*given) for one in pair.both)
        pair.sent = fast.limited.setpoint
        late = [one.settle() for one in pair.both]
        kept.append((fast, wanted, late))
    for fast, wanted, (signals, _) in kept:
        same(fast, wanted)
        for name, value in wanted.law_output.signals.items():
            equal((fast.law_output.signals | signals)[name], value, name)


def test_numbers_that_are_not_finite_are_limited_as_in_python() -> None:
    pair = Pair(law_named("practical"))
    for index, (vehicle, age_s, ahead, dt_s, known) in enumerate(cycles(4, np.random.default_rng(4), 0.1)):
        lost = replace(ahead, acceleration_w_mps2=np.full(3, np.nan))
        output = pair.fly(vehicle, age_s, lost if index == 3 else ahead, pair.sent, dt_s, known)
    assert output.limited.not_finite
    assert np.isfinite(output.limited.setpoint.q_w_flu_wxyz).all()
