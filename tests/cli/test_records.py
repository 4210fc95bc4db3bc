"""`companion records`: lists flights, and writes one as CSV."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from companion.analysis.report.number_tables import head
from companion.analysis.report.numbers import numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.cli.commands import app
from companion.cli.records.records import _line, _row
from companion.cli.working import Counted
from companion.core.interfaces import CompanionError
from companion.records.index import flight_summaries
from companion.records.read import read_flight
from companion.records.recorder import Recorder
from tests.records.flown import flight
from tests.records.test_round_trip import written


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["records", *map(str, arguments)])


def test_flights_are_listed_whole_and_broken_ones_alike(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight(track_s=2.0))
    whole = json.loads(run(tmp_path, "--json").stdout)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    broken = json.loads(run(tmp_path, "--json").stdout)
    assert [one["ended"] for one in whole] == ["disarmed: the operator\nwants it"]
    assert (whole[0]["law"], whole[0]["truncated"]) == ("practical", False)
    assert whole[0]["length_s"] == pytest.approx(2.2, abs=0.05)
    assert whole[0]["begin_s"] == pytest.approx(1.7e9 + 100.11, abs=0.01)
    assert (broken[0]["ended"], broken[0]["truncated"]) == ("track", True)
    assert "breaks" in run(tmp_path).stdout
    assert path.name in run(tmp_path).stdout


def test_csv_has_every_number_in_full(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight())
    assert run(path, "--csv", tmp_path / "out").exit_code == 0
    with (tmp_path / "out" / "ticks.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = read_flight(path).columns
    assert [float(row["time_s"]) for row in rows] == columns["time_s"].tolist()
    read = [float(row["law_v0_1_2"] or "nan") for row in rows]
    np.testing.assert_array_equal(read, columns["law_v0"][:, 1, 2])
    assert rows[-1]["reason"] == "the operator\nwants it"
    with (tmp_path / "out" / "faults.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["reaction"] == "disarm"


def test_what_is_no_record_is_said_and_the_others_are_listed(tmp_path: Path) -> None:
    written(tmp_path, flight())
    (tmp_path / "notes.mcap").write_text("no record", encoding="utf-8")
    result = run(tmp_path)
    assert "notes.mcap: no record of a flight" in result.stderr
    assert "practical" in result.stdout
    for wrong in ([tmp_path / "nowhere"], [tmp_path, "--csv", tmp_path / "out"], [tmp_path / "notes.mcap"]):
        assert isinstance(run(*wrong).exception, CompanionError)


def test_a_reason_that_does_not_fit_goes_on_below_and_is_never_cut(tmp_path: Path) -> None:
    written(tmp_path, flight())
    (line,) = flight_summaries(tmp_path)
    why = "the pose of motion capture is the same to the last bit for 0.15 s, and PX4 lands"
    row, widths = _row(replace(line, ended=f"disarmed: {why}")), [24, 6, 6, 9]
    wrapped = _line(row, widths, room=28).splitlines()
    assert len(wrapped) > 2
    assert all(len(one) <= sum(widths) + 2 * 4 + 28 for one in wrapped)
    assert " ".join(" ".join(wrapped).split()).endswith(why)
    assert len(_line(row, widths, room=4).splitlines()) == 1, "too narrow to wrap: as the terminal has it"


def test_a_long_look_says_on_stderr_that_it_is_at_work(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.cli.working._SHOW_AFTER_S", 0.0)
    with Counted("records looked into") as progress:
        for done in range(5):
            progress(done, 5)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "companion: records looked into: 0 of 5 so far; finished parts are kept for the next run\n"


def test_the_newest_flight_is_the_last_also_among_files_without_a_date(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight())
    recorder = Recorder()
    for tick in flight(track_s=0.1):
        recorder(tick)
    recorder.write(tmp_path / "virtual-ellipse.npz")
    os.utime(tmp_path / "virtual-ellipse.npz", (1.6e9, 1.6e9))
    names = [Path(one["path"]).name for one in json.loads(run(tmp_path, "--json").stdout)]
    assert names == ["virtual-ellipse.npz", path.name]


def test_a_damaged_record_is_listed_and_its_report_says_so(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight(track_s=1.2))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + bytes(9) + data[len(data) // 2 + 9 :])
    state = dict(head(numbers_of(Flown(read_flight(path)))))["record"]
    assert state.startswith("damaged: ")
    assert "cycles are missing" in state
    assert path.name in run(tmp_path).stdout
