"""A flight of the whole loop in simulated time, recorded, and fed through estimator, law and guard again."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from companion.analysis.replay.laws import config_of, law_of, laws_of
from companion.analysis.replay.rerun import Replayed, replay
from companion.cli.commands import app
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_path, load_controller
from companion.core.interfaces import CompanionError
from companion.records.read import FlightRecord, read_flight
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from tests import warm
from tests.flights.simulated import Flight, fly
from tests.flights.test_simulated_flights import DOWN, UP, ask, until, wait
from tests.flights.test_simulated_safety import do
from tests.records.flown import flight as standing
from tests.records.test_round_trip import written

pytestmark = pytest.mark.slow

CONFIG = CompanionConfig()
LAP = Ellipse(np.array([0.0, 0.0, 1.2]), (0.5, 0.3), LapTiming(6.0, 1))


def to_pid(flight: Flight) -> None:
    law = load_controller("pid", CONFIG.vehicle_model(), 0.01).law
    flight.loop.switch(law, "pid")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With another law from the middle of the lap on, which is then loaded again."""
    laps = [until(Phase.TRACK), wait(2.0), do(to_pid), wait(1.0), do(to_pid), wait(3.0)]
    script = [*UP, ask(TrackRequest(LAP, 0.5)), *laps, *DOWN]
    flight = asyncio.run(fly(script))
    ticks = [replace(tick, law=tick.law or "etnn") for tick in flight.ticks]
    laws = {name: controller_path(name).read_text(encoding="utf-8") for name in ("etnn", "pid")}
    begin = {"config": CONFIG.model_dump(mode="json"), "laws": laws, "unix_offset_s": 0.0}
    (one,) = written(tmp_path_factory.mktemp("records"), ticks, begin)
    return one


@pytest.fixture(scope="module")
def record(path: Path) -> FlightRecord:
    return read_flight(path)


def again(record: FlightRecord) -> Replayed:
    config = config_of(record)
    return replay(record, config, laws_of(record, config))


def test_it_is_identical_to_the_last_bit_also_where_another_law_took_over(record: FlightRecord) -> None:
    done = again(record)
    assert done.identical, [one for one in done.differences.values() if one.differ]
    assert done.flown > 1000
    for name in ("command", "setpoint attitude", "setpoint thrust", "law f_hat", "law integral_mps2", "law kappa"):
        assert done.differences[name].compared > 300, name
    assert done.differences["estimate velocity_w_mps"].compared > 1000
    for name in ("sent attitude", "sent thrust", "horizon"):
        assert done.differences[name].compared > 1000, name
    assert done.events[0] == done.events[1] > 0


def test_a_frame_that_is_not_as_it_was_shows_in_the_estimate_and_nowhere_else(record: FlightRecord) -> None:
    columns = {name: column.copy() for name, column in record.columns.items()}
    row = np.flatnonzero(np.isfinite(columns["frame_stamp_s"]))[500]
    columns["frame_position_w_m"][row, 0] += 1e-6
    done = again(replace(record, columns=columns))
    assert done.differences["estimate position_w_m"].differ > 0
    assert 0.0 < done.differences["estimate position_w_m"].most < 1e-5
    assert done.differences["command"].differ == 0


def test_another_horizon_of_the_autopilot_shows_in_what_is_sent_alone(record: FlightRecord) -> None:
    columns = {name: column.copy() for name, column in record.columns.items()}
    flying = columns["horizon_flying"] > 0.0
    assert np.abs(columns["horizon_roll_rad"][flying]).max() > 1e-4, "something was corrected"
    columns["horizon_autopilot_q_w_flu_wxyz"][np.flatnonzero(flying)[300:], 1] += 1e-3
    done = again(replace(record, columns=columns))
    assert done.differences["horizon"].differ > 0
    assert 0.0 < done.differences["sent attitude"].most < 2e-3
    assert done.differences["sent thrust"].differ == done.differences["setpoint attitude"].differ == 0


def test_a_law_that_was_given_something_else_shows_in_its_command(record: FlightRecord) -> None:
    columns = {name: column.copy() for name, column in record.columns.items()}
    row = np.flatnonzero(np.isfinite(columns["given_dt_s"]))[400]
    columns["given_position_w_m"][row, 1] += 1e-3
    done = again(replace(record, columns=columns))
    assert done.differences["estimate position_w_m"].differ == 0
    assert done.differences["law x1"].differ == 1
    assert done.differences["command"].differ > 1, "the law remembers"
    assert done.differences["command"].first_s is not None


def test_other_gains_are_compared_with_what_flew(record: FlightRecord, tmp_path: Path) -> None:
    text = controller_path("pid").read_text(encoding="utf-8")
    config = config_of(record)
    same = replay(record, config, laws_of(record, config), law_of("pid", text, config))
    assert same.differences.keys() == {"command"}
    assert same.differences["command"].differ > 0
    flown_by_pid = np.array([str(name) == "pid" for name in record.columns["law_name"]])
    assert same.flown > flown_by_pid.sum()


def test_the_command_says_identical_and_ends_with_0(path: Path) -> None:
    ran = warm.run("companion.cli.main", "replay", str(path))
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("identical to the last bit")
    told = warm.run("companion.cli.main", "replay", str(path), "--controller", "pid", "--json")
    assert told.returncode == 0
    numbers = json.loads(told.stdout)
    assert numbers["sent_again"] == numbers["flown"], "pid sends in every cycle"


def test_a_flight_in_which_no_law_ran_has_nothing_to_compare(record: FlightRecord, tmp_path: Path) -> None:
    """Arm, then disarm: written as such a flight is, without a law's column."""
    ticks = [tick for tick in standing(start_s=50.0) if tick.pipeline is None]
    begin = {"config": CONFIG.model_dump(mode="json"), "unix_offset_s": 0.0}
    (path,) = written(tmp_path, ticks, begin)
    assert "event" not in read_flight(path).columns
    for command in ("replay", "calibrate"):
        ran = warm.run("companion.cli.main", command, str(path))
        assert ran.returncode == {"replay": 2, "calibrate": 1}[command], ran.stderr
        assert f"{path}: the law was never in charge in this flight: nothing to" in ran.stderr
        assert "Traceback" not in ran.stderr
    out = tmp_path / "page.html"
    for arguments in (["report", str(path), "--out", str(out)], ["records", str(path), "--csv", str(tmp_path / "csv")]):
        said = CliRunner().invoke(app, arguments)
        assert said.exit_code == 0, said.output
    assert "Disarmed, it never left the ground" in out.read_text(encoding="utf-8")


def test_a_record_of_another_version_is_refused_in_one_sentence(record: FlightRecord) -> None:
    other = replace(record, metadata=record.metadata | {"config": {"vehicle": {"wings": 2}}})
    with pytest.raises(CompanionError, match=r"wings"):
        config_of(other)
    config = config_of(record)
    columns = record.columns | {"law_f_hat": np.zeros((len(record.columns["time_s"]), 7))}
    with pytest.raises(CompanionError, match="another version's law"):
        replay(replace(record, columns=columns), config, laws_of(record, config))
    newtons = record.metadata["laws"] | {"pid": 'law = "pid"\ngains.kp = [8.0, 8.0, 10.0]\n'}
    with pytest.raises(CompanionError, match=r"^the law 'pid' as it flew .*: gains: kp: gains in newtons .* kp_per_s2"):
        laws_of(replace(record, metadata=record.metadata | {"laws": newtons}), config)
    nameless = record.columns | {"law_name": np.full(len(record.columns["time_s"]), "")}
    with pytest.raises(CompanionError, match="does not say which law flew"):
        laws_of(replace(record, columns=nameless), config)
    few = {name: column for name, column in record.columns.items() if name not in {"given_dt_s", "event"}}
    with pytest.raises(CompanionError, match="the law was never in charge"):
        replay(replace(record, columns=few), config, laws_of(record, config))


def test_what_has_no_configuration_is_refused_in_one_sentence(record: FlightRecord) -> None:
    with pytest.raises(CompanionError, match=r"has no configuration"):
        config_of(replace(record, metadata={}))
