"""Tests that records are read back bit by bit, with a law's own arrays as they were in their tick."""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove import Context

from companion.config.arms_config import ArmsConfig
from companion.config.records_config import RecordsConfig
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.flight.tick import Tick
from companion.records.exact_json import of_json, to_json
from companion.records.flight_file import FlightFiles
from companion.records.read import FlightRecord, RecordError, read_flight
from companion.records.recorder import Recorder
from companion.records.retention import Retention
from companion.records.row_codec import LAYOUT, ROW, START, RowDecoder, RowEncoder
from companion.records.tick_columns import frozen
from companion.supervisor.flight_state import Phase
from tests.records.flown import CONFIG, flight

BEGIN = {"unix_offset_s": 1.7e9, "config": CONFIG.model_dump(mode="json"), "seed": 7}


def written(folder: Path, ticks: Iterable[Tick], begin: dict[str, Any] | None = None, **config: Any) -> list[Path]:
    """Write a record as the writer does, in this process."""
    settings = RecordsConfig.model_validate({"folder": str(folder), "live_port": 0, "min_free_mb": 0.0} | config)
    files = FlightFiles(Retention(settings, "one"), Context(), lambda _: None)
    usual = BEGIN | {"config": {"arms": ArmsConfig().model_dump(mode="json")}}
    files.begin(b"B" + json.dumps(usual if begin is None else begin).encode())
    encoder = RowEncoder()
    do = {LAYOUT: files.learn, START: files.start, ROW: files.row}
    for tick in ticks:
        for message in encoder.messages(tick, frozen(tick)):
            do[message[:1]](message)
    files.event(b"T" + json.dumps({"time_s": tick.time_s, "kind": "command", "text": "hold"}).encode())
    files.close()
    return sorted(folder.glob("*.mcap"))


def flown(tmp_path: Path, **how: Any) -> tuple[list[Tick], FlightRecord]:
    ticks = list(flight(**how))
    (path,) = written(tmp_path, ticks)
    return [tick for tick in ticks if tick.flight.phase is not Phase.STANDBY], read_flight(path)


def test_every_column_of_the_recorder_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    ticks, record = flown(tmp_path)
    recorder = Recorder()
    for tick in ticks:
        recorder(tick)
    for name, column in recorder.arrays().items():
        assert record.columns[name].dtype.kind == column.dtype.kind.replace("i", "f"), name
        np.testing.assert_array_equal(record.columns[name], column, name)
    assert not record.truncated
    assert record.dropped == 0
    assert record.metadata["seed"] == 7
    assert [(event.kind, event.text) for event in record.events] == [("command", "hold")]


def test_a_replay_gets_exactly_what_the_law_and_the_estimator_had(tmp_path: Path) -> None:
    ticks, record = flown(tmp_path)
    state = record.first_estimate
    read = list(record.ticks())
    assert len(read) == len(ticks)
    for was, now in zip(ticks, read, strict=True):
        assert (now.frame is None) == (was.frame is None)
        assert (now.given is None) == (was.pipeline is None)
        if now.frame is not None and now.number > read[0].number:
            assert state is not None
            state = estimator.step(state, now.frame, EstimatorParams())
        assert to_json(state) == to_json(was.estimate)
        if was.pipeline is not None and was.limited is not None:
            assert now.given is not None
            assert now.setpoint is not None
            assert to_json(now.given) == to_json(was.pipeline.given)
            assert now.begun == was.pipeline.begun
            assert to_json(now.setpoint) == to_json(was.limited.setpoint)
            assert to_json(now.signals) == to_json(was.pipeline.law_output.signals | was.late_signals)


def test_another_law_brings_its_own_signals_in_the_same_flight(tmp_path: Path) -> None:
    _, record = flown(tmp_path, controllers=("practical", "pid"))
    columns = record.columns
    pid = (columns["law_name"] == "pid") & (columns["phase"] == "track")
    assert np.isfinite(columns["law_integral_mps2"][pid]).all()
    assert np.isnan(columns["law_integral_mps2"][~pid]).all()
    assert np.isfinite(columns["law_x1"][columns["phase"] == "track"]).all()
    assert np.isnan(columns["law_v0"][pid]).all()


def test_faults_come_back_with_their_reaction_and_their_end(tmp_path: Path) -> None:
    ticks, record = flown(tmp_path)
    (fault,) = record.health
    assert (fault.fault, fault.text, fault.reaction) == ("disk full", '1 MB free, 100 % "full"', "disarm")
    assert fault.time_s == ticks[0].time_s
    assert fault.end_s == next(tick.time_s for tick in ticks if not tick.events)


def test_a_laws_array_that_is_written_to_later_is_recorded_as_it_was() -> None:
    tick = next(tick for tick in flight() if tick.pipeline is not None)
    assert tick.pipeline is not None
    signals, decoder, encoder = frozen(tick), RowDecoder(), RowEncoder()
    was = tick.pipeline.law_output.signals["x1"].copy()
    tick.pipeline.law_output.signals["x1"] += 1.0
    for message in encoder.messages(tick, signals):
        if message[:1] == LAYOUT:
            decoder.learn(message)
    np.testing.assert_array_equal(decoder.row(message).cell("law_x1"), was)


def test_each_flight_has_a_file_that_ends_seconds_after_it(tmp_path: Path) -> None:
    ticks = [*flight(after_s=4.0), *flight(start_s=200.0)]
    first, second = map(read_flight, written(tmp_path, ticks))
    times_s = first.columns["time_s"]
    ended_s = times_s[first.columns["phase"] == "disarmed"][0]
    assert times_s[-1] == pytest.approx(ended_s + 3.0, abs=0.03)
    assert second.columns["time_s"][0] > 200.0
    assert set(second.columns["phase"]) == {"preflight", "track", "disarmed"}


def test_a_signal_that_changes_its_shape_is_kept_under_a_second_name(tmp_path: Path) -> None:
    ticks = list(flight())
    late = [index for index, tick in enumerate(ticks) if tick.late_signals]
    for index in late[10:]:
        object.__setattr__(ticks[index], "late_signals", {"f_hat": np.zeros(6)})
    (path,) = written(tmp_path, ticks)
    columns = read_flight(path).columns
    assert columns["law_f_hat"].shape[1:] == (3,)
    assert columns["law_f_hat_6"].shape[1:] == (6,)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, -0.0, 5e-324, 0.1 + 0.2])
def test_any_float_survives_json(value: float) -> None:
    state = EstimatorState(stamp_s=value)
    back = of_json(EstimatorState, to_json(state)).stamp_s
    assert math.copysign(1.0, back) == math.copysign(1.0, value)
    assert back == value or (math.isnan(back) and math.isnan(value))


def test_a_file_that_is_no_record_is_one_sentence(tmp_path: Path) -> None:
    for name, content in (
        ("a.mcap", b""),
        ("b.mcap", b"\x89MCAP0\r\n"),
        ("c.mcap", b"\x89MCAP0\r\n" + bytes(500)),
        ("d.npz", b"PK\x03\x04 no"),
        ("e.txt", b"hello"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordError, match=name):
            read_flight(tmp_path / name)
    with pytest.raises(RecordError, match="No such file"):
        read_flight(tmp_path / "none.mcap")


def test_an_old_npz_file_is_read(tmp_path: Path) -> None:
    recorder = Recorder()
    for tick in flight():
        recorder(tick)
    recorder.write(tmp_path / "old.npz")
    record = read_flight(tmp_path / "old.npz")
    np.testing.assert_array_equal(record.columns["law_x1"], recorder.arrays()["law_x1"])
    with pytest.raises(RecordError, match="too old"):
        next(record.ticks())


def test_a_record_that_was_cut_off_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight(track_s=3.0))
    whole, data = read_flight(path), path.read_bytes()
    counts = []
    for share in (0.5, 0.7, 0.9):
        path.write_bytes(data[: int(share * len(data))])
        record = read_flight(path)
        assert record.truncated
        counts.append(len(record.columns["time_s"]))
        np.testing.assert_array_equal(record.columns["time_s"], whole.columns["time_s"][: counts[-1]])
    assert 50 < counts[0] < counts[1] < counts[2] < len(whole.columns["time_s"])


def test_whatever_a_law_calls_a_signal_is_recorded_or_is_nan(tmp_path: Path) -> None:
    ticks = list(flight())
    odd = {
        "turned": np.arange(6.0).reshape(2, 3).T,
        "float": 2.5,
        "integers": np.array([1, 2]),
        "short": np.array([0.5], np.float32),
        "true": np.array(True),
        "words": np.array(["a"]),
        "none": None,
        "name": 3.0,
    }
    flown_ticks = [tick for tick in ticks if tick.pipeline is not None]
    for tick in flown_ticks[:5] + flown_ticks[20:]:
        object.__setattr__(tick, "late_signals", odd)
    for tick in flown_ticks[5:20]:  # all in one piece of memory
        whole = {name: odd[name] for name in ("integers", "short", "true", "words")}
        object.__setattr__(tick, "late_signals", whole)
    (path,) = written(tmp_path, ticks)
    columns = read_flight(path).columns
    flying = columns["phase"] == "track"
    np.testing.assert_array_equal(columns["law_turned"][flying][-1], odd["turned"])
    for name, value in (("float", 2.5), ("integers", [1.0, 2.0]), ("short", [0.5]), ("true", 1.0)):
        for row in (-1, 10) if name != "float" else (-1,):
            np.testing.assert_array_equal(columns[f"law_{name}"][flying][row], value, name)
    assert np.isnan(columns["law_words"]).all()
    assert np.isnan(columns["law_none"]).all()
    assert columns["law_name_"][flying][-1] == 3.0
    assert set(columns["law_name"]) == {"practical"}
