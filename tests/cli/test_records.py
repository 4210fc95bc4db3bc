"""`companion records`: lists flights, and writes one as CSV."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from companion.cli.commands import app
from companion.ports import CompanionError
from companion.records.read import read_flight
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
        assert next(csv.DictReader(file))["reaction"] == "stop"


def test_what_is_no_record_is_said_and_the_others_are_listed(tmp_path: Path) -> None:
    written(tmp_path, flight())
    (tmp_path / "notes.mcap").write_text("no record", encoding="utf-8")
    result = run(tmp_path)
    assert "notes.mcap: no record of a flight" in result.stderr
    assert "practical" in result.stdout
    for wrong in ([tmp_path / "nowhere"], [tmp_path, "--csv", tmp_path / "out"], [tmp_path / "notes.mcap"]):
        assert isinstance(run(*wrong).exception, CompanionError)
