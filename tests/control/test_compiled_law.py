"""The compiled law is the law: every number the same, cycle after cycle, whatever the vehicle does."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.compiled.library import library
from companion.config.controller_config import load_controller
from companion.control.compiled_law import CompiledLawOfMany, compiled_law_of_many
from companion.control.controller import ControlInput, VehicleModel
from companion.core.types import Reference

pytestmark = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")


def inputs(rng: np.random.Generator) -> ControlInput:
    """A cycle somewhere near a flight."""
    q = np.array((1.0, 0.0, 0.0, 0.0)) + 0.2 * rng.normal(size=4)
    return ControlInput(
        position_w_m=rng.normal(size=3) * 0.3,
        velocity_w_mps=rng.normal(size=3) * 0.5,
        q_w_flu_wxyz=q / np.sqrt(q @ q),
        rate_flu_radps=rng.normal(size=3),
        age_s=0.01 + 0.01 * rng.random(),
        reference=Reference(rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.4, rng.normal(size=3), rng.normal()),
        sent_accel_w_mps2=rng.normal(size=3),
        dt_s=0.008 + 0.004 * rng.random(),
        known_accel_w_mps2=0.1 * rng.normal(size=3),
    )


def test_of_many_vehicles_each_is_flown_as_it_would_be_alone() -> None:
    law = load_controller("practical", VehicleModel(), 0.01).law
    many = compiled_law_of_many(law)
    assert isinstance(many, CompiledLawOfMany)
    rng, dt_s = np.random.default_rng(5), 0.01
    cycles = [[replace(inputs(rng), dt_s=dt_s) for _ in range(3)] for _ in range(20)]
    memory, memories = many.initial(together(cycles[0])), [law.initial(alone) for alone in cycles[0]]
    for cycle in cycles:
        memory, output = many.step(memory, together(cycle))
        for index, alone in enumerate(cycle):
            memories[index], wanted = law.step(memories[index], alone)
            np.testing.assert_array_equal(output.accel_w_mps2[index], wanted.accel_w_mps2)
            np.testing.assert_array_equal(output.event[index], wanted.event)


def together(alone: list[ControlInput]) -> ControlInput:
    """Vehicles (B,) from single ones."""

    def rows(get: Callable[[ControlInput], Any]) -> Any:
        return np.array([get(one) for one in alone])

    return ControlInput(
        position_w_m=rows(lambda one: one.position_w_m),
        velocity_w_mps=rows(lambda one: one.velocity_w_mps),
        q_w_flu_wxyz=rows(lambda one: one.q_w_flu_wxyz),
        rate_flu_radps=rows(lambda one: one.rate_flu_radps),
        age_s=rows(lambda one: one.age_s)[:, None],
        reference=Reference(
            rows(lambda one: one.reference.position_w_m),
            rows(lambda one: one.reference.velocity_w_mps),
            rows(lambda one: one.reference.acceleration_w_mps2),
            rows(lambda one: one.reference.yaw_rad),
        ),
        sent_accel_w_mps2=rows(lambda one: one.sent_accel_w_mps2),
        dt_s=alone[0].dt_s,
        known_accel_w_mps2=rows(lambda one: one.known_accel_w_mps2),
    )


def test_a_law_that_cannot_be_compiled_stays_as_it_is() -> None:
    pid = load_controller("pid", VehicleModel(), 0.01).law
    assert compiled_law_of_many(pid) is pid
