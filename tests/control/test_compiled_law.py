"""The compiled law is the law: every number the same, cycle after cycle, whatever the vehicle does."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.compiled.library import library
from companion.config.controller_config import load_controller
from companion.control.compiled_law import CompiledLaw, compiled_law
from companion.control.controller import ControlInput, VehicleModel
from companion.control.etnn import Etnn
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


@pytest.mark.parametrize("name", ["practical", "precise", "paper-repaired"])
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from((0.01, 0.3, 3.0)), printed=st.booleans())
@settings(max_examples=20, deadline=None)
def test_every_number_of_a_cycle_is_the_same(name: str, seed: int, spread: float, printed: bool) -> None:
    law = load_controller(name, VehicleModel(), 0.01).law
    assert isinstance(law, Etnn)
    if printed:  # neither regularised nor with a boundary layer
        law = replace(law, gains=law.gains.model_copy(update={"power_regularisation": 0.0, "boundary_layer_mps": 0.0}))
    fast = compiled_law(law)
    assert isinstance(fast, CompiledLaw)
    rng = np.random.default_rng(seed)
    first = inputs(rng)
    memory, other = law.initial(first), fast.initial(first)
    for _ in range(30):
        now = inputs(rng)
        now = replace(now, position_w_m=now.reference.position_w_m + spread * now.position_w_m)
        memory, wanted = law.step(memory, now)
        other, output = fast.step(other, now)
        np.testing.assert_array_equal(output.accel_w_mps2, wanted.accel_w_mps2)
        np.testing.assert_array_equal(output.event, wanted.event)
        assert output.signals.keys() == wanted.signals.keys()
        for signal, value in wanted.signals.items():
            np.testing.assert_array_equal(output.signals[signal], value, err_msg=signal)


def test_it_takes_control_in_the_air_as_the_law_does() -> None:
    law = load_controller("practical", VehicleModel(), 0.01).law
    assert isinstance(law, Etnn)
    fast = compiled_law(law)
    assert isinstance(fast, CompiledLaw)
    now, push = inputs(np.random.default_rng(2)), np.array((0.5, -0.3, 0.1))
    _, wanted = law.step(law.initial_with(now, push), now)
    _, output = fast.step(fast.initial_with(now, push), now)
    np.testing.assert_array_equal(output.accel_w_mps2, wanted.accel_w_mps2)


def test_a_law_that_cannot_be_compiled_stays_as_it_is() -> None:
    pid = load_controller("pid", VehicleModel(), 0.01).law
    assert compiled_law(pid) is pid
