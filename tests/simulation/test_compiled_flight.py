"""The compiled loop flies as the Python does, to the last bit, and leaves to it what it cannot."""

import ctypes
import runpy
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.compiled.library import LIBRARY, WIDTHS, build, library, library_path
from companion.config.controller_config import LoadedController
from companion.control.etnn import Etnn
from companion.simulation import compiled_flight
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace, simulate, simulate_in_python
from companion.simulation.traces import SOURCE, functions, source
from companion.simulation.virtual_world import VirtualVehicle
from companion.studies.sweep.sweep_vehicles import draw, vehicles
from mock_autopilot.px4.attitude_error import AttitudeErrorParams
from tests.simulation.scenes import PUSHED, QUIET, law_for, scene

compiled = pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
RANDOM: dict[str, Any] = {"attitude_error_source": "random", "attitude_error_rad": None}


def rough(**mock: Any) -> Scene:
    """A lap with arms, disturbance and a horizon that errs."""
    return scene(arms="swing", disturbance=PUSHED, estimator=RANDOM, **mock)


def both(flown: Scene, law: LoadedController, vehicle: VirtualVehicle, seeds: list[int]) -> tuple[Trace, Trace]:
    mission = flown.mission(law.law.preview_s)
    mission = stacked([mission] * len(seeds)) if len(seeds) > 1 else mission
    return tuple(fly(flown.pilot(law), vehicle, mission, seeds) for fly in (simulate, simulate_in_python))  # type: ignore[return-value]


def columns(trace: Trace) -> dict[str, Any]:
    return {name: getattr(trace, name) for name in ("position_w_m", "velocity_w_mps", "accel_w_mps2", "event", "sent")}


def test_the_c_source_is_what_the_python_says() -> None:
    assert SOURCE.read_text(encoding="utf-8") == source(functions())


@pytest.mark.parametrize(
    ("script", "why"), [("echo no headers >&2; exit 1", "no headers"), ("exit 3", "exit code 3"), ("", "no C compiler")]
)
def test_a_compiler_that_fails_or_is_missing_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, why: str
) -> None:
    if script:
        (tmp_path / "cc").write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    said = build()
    assert why in said
    assert said.endswith("Python flies, with the same numbers, slower")


@compiled
@pytest.mark.parametrize("changed", [None, "flight.c", "flight.h", "batch.c", "traced.c"])
def test_what_was_compiled_from_another_source_does_not_fly(tmp_path: Path, changed: str | None) -> None:
    folder = shutil.copytree(LIBRARY.parent, tmp_path / "compiled")
    if changed is not None:
        with (folder / changed).open("a", encoding="utf-8") as file:
            file.write("/* changed */\n")
    found = runpy.run_path(str(folder / "library.py"))["library"]()
    assert (found is None) == (changed is not None)


@compiled
@pytest.mark.parametrize("name", ["practical", "precise", "paper-repaired"])
def test_a_flight_is_the_same_to_the_last_bit(name: str) -> None:
    flown = rough()
    law = law_for(flown, name)
    fast, reference = both(flown, law, flown.vehicle(), [3])
    for column, value in columns(fast).items():
        np.testing.assert_array_equal(value, getattr(reference, column), err_msg=column)


@compiled
def test_another_vehicle_with_other_limits_is_flown_as_well() -> None:
    """Every number of the companion's side is another than a default: none is left in the compiled code."""
    flown = rough()
    told = flown.companion.vehicle.model_copy(
        update={"mass_kg": 1.7, "hover_thrust": 0.41, "attitude_bandwidth_radps": 9.0, "setpoint_delay_s": 0.063}
    )
    limits = flown.companion.limits.model_copy(update={"max_tilt_rad": 0.4, "max_thrust": 0.7, "min_thrust": 0.1})
    flown = replace(flown, companion=flown.companion.model_copy(update={"vehicle": told, "limits": limits}))
    plant = replace(flown.mock.plant, mass_kg=1.6, max_thrust_n=1.6 * 9.80665 / 0.43)
    flown = replace(flown, mock=flown.mock.model_copy(update={"plant": plant}))
    law = law_for(flown, allow_unstable=True)
    fast, reference = both(flown, law, flown.vehicle(), [9])
    for column, value in columns(fast).items():
        np.testing.assert_array_equal(value, getattr(reference, column), err_msg=column)


@compiled
def test_frames_that_are_lost_change_nothing_of_that() -> None:
    flown = rough()
    law = law_for(flown)
    cycles = len(flown.mission(law.law.preview_s).time_s)
    unseen = np.random.default_rng(1).random(cycles) < 0.2
    fast, reference = both(flown, law, replace(flown.vehicle(), unseen=unseen), [4])
    np.testing.assert_array_equal(fast.position_w_m, reference.position_w_m)


@compiled
def test_vehicles_of_a_batch_fly_as_each_would_alone() -> None:
    flown = rough()
    law = law_for(flown)
    fast, _ = both(flown, law, flown.vehicle(), [5, 6])
    mission = flown.mission(law.law.preview_s)
    for index, seed in enumerate((5, 6)):
        alone = simulate_in_python(flown.pilot(law), flown.vehicle(), mission, [seed])
        np.testing.assert_array_equal(fast.position_w_m[:, index], alone.position_w_m)
        np.testing.assert_array_equal(fast.sent[:, index], alone.sent)


@compiled
@pytest.mark.parametrize("width", WIDTHS)
def test_vehicles_side_by_side_fly_as_one_after_another_to_the_last_bit(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Drawn vehicles, each with delays, lost frames and noise of its own, and more of them than stand side by side."""
    code = library()
    if code is None or code.lanes() < width or not library_path(width=width).is_file():
        pytest.skip(f"this computer has no instructions for {width} side by side")
    flown = rough()
    law, drawn = law_for(flown), draw(7, range(width + 2))
    mission = stacked([flown.mission(law.law.preview_s)] * (width + 2))
    world = vehicles(flown, drawn, len(mission.time_s))
    np.asarray(world.plant.mass_kg)[1] = 9.0  # so heavy that it falls to the floor
    traces = []
    for batch in (ctypes.CDLL(str(library_path(width=width))), None):
        monkeypatch.setattr(compiled_flight, "side_by_side", lambda batch=batch: batch)
        traces.append(simulate(flown.pilot(law), world, mission, drawn.flight_seed.tolist()))
    together, one_by_one = traces
    for column, value in columns(together).items():
        np.testing.assert_array_equal(value, getattr(one_by_one, column), err_msg=column)


@compiled
def test_drawn_vehicles_without_trigger_fly_as_in_a_numpy_batch() -> None:
    flown = rough()
    law = law_for(flown)
    assert isinstance(law.law, Etnn)
    steady = law.law.gains.model_copy(update={"every_cycle": True})
    law = replace(law, law=replace(law.law, gains=steady))
    drawn = draw(7, range(4))
    world = vehicles(flown, drawn, len(flown.mission(law.law.preview_s).time_s))
    fast, reference = both(flown, law, world, drawn.flight_seed.tolist())
    np.testing.assert_allclose(fast.position_w_m, reference.position_w_m, rtol=0.0, atol=1e-9)


@compiled
def test_a_frame_that_is_not_simply_accepted_is_left_to_python() -> None:
    standing = scene(qualisys=QUIET)  # without noise a pose repeats itself
    law = law_for(standing)
    mission = standing.mission(law.law.preview_s)
    assert compiled_flight.fly(standing.pilot(law), standing.vehicle(), mission, [1], None) is None
    fast, reference = both(standing, law, standing.vehicle(), [1])
    np.testing.assert_array_equal(fast.position_w_m, reference.position_w_m)


@compiled
def test_a_law_that_is_not_compiled_flies_in_python() -> None:
    flown = scene()
    pid = law_for(flown, "pid")
    mission = flown.mission(pid.law.preview_s)
    assert compiled_flight.fly(flown.pilot(pid), flown.vehicle(), mission, [1], None) is None


@compiled
def test_a_recorded_horizon_is_flown_too() -> None:
    flown = scene(disturbance=PUSHED)
    law = law_for(flown)
    vehicle = replace(flown.vehicle(), attitude_error=AttitudeErrorParams(source="px4-a"))
    fast, reference = both(flown, law, vehicle, [8])
    np.testing.assert_array_equal(fast.position_w_m, reference.position_w_m)
