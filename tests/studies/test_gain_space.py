"""The space of gains: there and back, and the same gains whether they fly as one of many or from a file."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.controller_config import load_controller, read_etnn
from companion.control.controller import VehicleModel
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains
from companion.control.pipeline import ControlPipeline, idle_setpoint
from companion.core.types import Reference, VehicleState
from companion.geometry.attitude import ThrustModel
from companion.guard.limits import Limits
from companion.studies.tuning.controller_writer import controller_toml
from companion.studies.tuning.gain_space import (
    KNOBS,
    START,
    damping_margin,
    gain_fields,
    law_of,
    rounded,
    shares_of,
    values_from,
    values_of,
)

SHARES = st.lists(st.floats(0.0, 1.0), min_size=len(KNOBS), max_size=len(KNOBS)).map(np.array)


@given(SHARES)
def test_a_point_is_found_again_from_its_values(point: np.ndarray) -> None:
    values = {name: float(value[0]) for name, value in values_of(point[None]).items()}
    np.testing.assert_allclose(shares_of(values), point, atol=1e-9)
    for knob in KNOBS:
        assert knob.low * (1 - 1e-12) <= values[knob.name] <= knob.high * (1 + 1e-12)


def test_what_lies_outside_the_cube_is_its_edge() -> None:
    edge, outside = values_of(np.ones((1, len(KNOBS)))), values_of(np.full((1, len(KNOBS)), 1.7))
    assert edge == outside


@given(SHARES)
def test_a_batch_has_the_gains_that_a_file_would_have(point: np.ndarray) -> None:
    values = rounded(point)
    one = gain_fields(values)
    law = law_of({name: np.array([value]) for name, value in values.items()}, VehicleModel(), 0.01)
    for name in EtnnGains.model_fields:
        np.testing.assert_allclose(np.ravel(getattr(law.gains, name)), np.ravel(getattr(one, name)), rtol=6e-3)


def test_sets_that_each_look_ahead_by_their_own_time_fly_in_one_pipeline() -> None:
    """In Python, too, where nothing is compiled: which halves a law has is found without its look-ahead."""
    law = law_of(values_of(np.array([[0.4] * len(KNOBS), [0.6] * len(KNOBS)])), VehicleModel(), 0.01)
    pipeline = ControlPipeline(law, ThrustModel(), Limits(), (2,))
    level = idle_setpoint(np.zeros(2))
    still = np.zeros((2, 3))
    vehicle = VehicleState(0.0, still, still, level.q_w_flu_wxyz, still)
    output = pipeline.fly(vehicle, 0.0, Reference(still, still, still, 0.0), level, 0.01)
    assert output.limited.setpoint.thrust.shape == (2,)


def test_the_margin_is_that_of_the_stability_check() -> None:
    rng = np.random.default_rng(4)
    for point in rng.uniform(0.0, 1.0, (20, len(KNOBS))):
        damping, needed = gain_fields(rounded(point)).filter_loop()
        assert damping_margin(point[None])[0] == pytest.approx(damping / needed, rel=0.02), "but for the rounding"


def test_the_start_is_a_stable_set() -> None:
    assert damping_margin(shares_of(START)[None])[0] > 1.2


def test_a_written_file_is_the_same_point_when_it_is_read(tmp_path: Path) -> None:
    values = rounded(shares_of(START))
    path = tmp_path / "tuned.toml"
    path.write_text(controller_toml(values, "A set.", "found here", "companion tune --seed 7"), encoding="utf-8")
    loaded = load_controller(str(path), VehicleModel(), 0.01)
    assert isinstance(loaded.law, Etnn)
    assert loaded.description == "found here"
    again = values_from(loaded.law.gains, read_etnn(str(path)).prediction)
    assert again == pytest.approx(values, rel=6e-3)
    assert "companion tune --seed 7" in path.read_text(encoding="utf-8")
