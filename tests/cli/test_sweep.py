import json
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import companion.cli.studies.sweep as command
from companion.cli.commands import app
from companion.core.interfaces import ConfigError
from companion.studies.sweep.sweep import Sweep
from tests.control.first_law import FAILING_LINE, failing_law
from tests.flights.command import ROOT
from tests.studies.sweep_rig import short_experiment

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command on a short experiment."""
    monkeypatch.setattr(command, "Sweep", partial(Sweep, experiments=(short_experiment(tmp_path),)))


def _sweep(folder: Path, *arguments: str) -> Result:
    return CliRunner().invoke(
        app, ["sweep", "--jobs", "1", "--out", str(folder / "out"), *arguments], env={"COLUMNS": "160"}
    )


def _json(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return data


def test_summary_table_and_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = _sweep(tmp_path, "--vehicles", "6", "--seed", "3", "--summary", str(tmp_path / "first.json"))
    assert first.exit_code == 0, first.output
    numbers = _json(tmp_path / "first.json")
    assert (numbers["vehicles"], numbers["diverged"], numbers["taken_over"]) == (6, 0, 0)
    assert numbers["seconds"] > 0.0
    with np.load(tmp_path / "out" / "practical-seed3.npz", allow_pickle=False) as file:
        assert numbers["vehicle_seconds"] == pytest.approx(file["flight_s"].sum())
    assert numbers["error_p95_m"].keys() == {"12.0", "6.3"}

    name = tmp_path / "out" / "practical-seed3"
    with np.load(name.with_suffix(".npz"), allow_pickle=False) as file:
        columns = dict(file)
    assert columns["vehicle"].tolist() == list(range(6))
    for nominal in (12.0, 6.3):
        errors_m = columns["error_whole_m"][columns["nominal_radps"] == nominal]
        assert numbers["error_p95_m"][f"{nominal:.1f}"] == errors_m.max()  # of three
        assert numbers["error_p50_m"][f"{nominal:.1f}"] == np.median(errors_m)
        assert f"{100.0 * errors_m.max():.2f}" in first.output
    worst = int(columns["error_whole_m"].argmax())
    assert f"worst: vehicle {worst}, error" in first.output
    assert f"mass (kg) {columns['mass_kg'][worst]:.4g}" in first.output
    assert name.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert name.with_suffix(".pdf").read_bytes().startswith(b"%PDF")

    monkeypatch.setattr("companion.studies.sweep.sweep_plots.plot_sweep", lambda *_: None)  # seconds, and seen above
    again = _sweep(tmp_path, "--vehicles", "6", "--seed", "3", "--summary", str(tmp_path / "again.json"))
    repeated = _json(tmp_path / "again.json")
    assert "6 of them by an earlier run" in again.output
    assert repeated["vehicle_seconds"] == 0.0
    timing = {"seconds": 0, "taken_over": 0, "vehicle_seconds": 0}
    assert repeated | timing == numbers | timing


def test_a_vehicle_that_diverges_is_exit_code_one(tmp_path: Path) -> None:
    """A law that never tells the vehicle to do anything: the disturbance and a wrong hover thrust take it away."""
    (tmp_path / "idle.py").write_text(_IDLE, encoding="utf-8")
    (tmp_path / "idle.toml").write_text('law = "idle.py:Idle"\n', encoding="utf-8")
    summary = tmp_path / "new folder" / "numbers.json"
    ran = _sweep(tmp_path, "--vehicles", "4", "--controller", str(tmp_path / "idle.toml"), "--summary", str(summary))
    assert ran.exit_code == 1, ran.output
    numbers = _json(summary)
    assert numbers["diverged"] == 4
    assert numbers["error_p95_m"] == {"12.0": None, "6.3": None}
    assert "diverged" in ran.output
    assert len(list((tmp_path / "out").glob("idle-??????-seed1.png"))) == 1


def test_two_controllers_of_one_name_leave_two_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.studies.sweep.sweep_plots.plot_sweep", lambda *_: None)
    shipped = (ROOT / "config" / "controllers" / "pid.toml").read_text(encoding="utf-8")
    for folder in ("a", "b"):
        path = tmp_path / folder / "pid.toml"
        path.parent.mkdir()
        path.write_text(shipped, encoding="utf-8")
        assert _sweep(tmp_path, "--vehicles", "1", "--controller", str(path)).exit_code == 0
    assert _sweep(tmp_path, "--vehicles", "1", "--controller", "pid").exit_code == 0
    tables = sorted(table.name for table in (tmp_path / "out").glob("*.npz"))
    assert len(tables) == 3
    assert "pid-seed1.npz" in tables


_IDLE = """
import numpy as np
from companion.control.controller import ControlOutput


class Idle:
    preview_s = 0.0

    def __init__(self, gains, vehicle, period_s):
        pass

    def initial(self, first):
        return None

    def step(self, memory, now):
        accel = 0.0 * now.position_w_m + [3.0, 0.0, 0.0]
        return None, ControlOutput(accel, np.ones((*accel.shape[:-1], 1)), {})
"""


def test_a_law_of_ones_own_that_raises_in_flight_is_one_sentence(tmp_path: Path) -> None:
    ran = _sweep(tmp_path, "--vehicles", "1", "--controller", str(failing_law(tmp_path)))
    assert isinstance(ran.exception, ConfigError)
    assert str(ran.exception) == f"{tmp_path / 'pd.py'}: raised in flight: KeyError: 'none' (line {FAILING_LINE})"


def test_ctrl_c_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run", interrupted)
    ran = _sweep(tmp_path, "--vehicles", "7")
    assert ran.exit_code == 130
    assert "interrupted: 0 of 7 vehicles are kept in" in ran.output
    assert "the same command goes on" in ran.output


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--controller", "lqr"], "unknown controller 'lqr'"),
        (["--summary", "FOLDER"], "is a folder: give the name of a file"),
        (["--out", "FILE"], "cannot write to"),
    ],
)
def test_a_mistake_is_one_sentence_before_the_work(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    paths = {"FOLDER": str(tmp_path), "FILE": str(tmp_path / "file")}
    ran = _sweep(tmp_path, *(paths.get(word, word) for word in arguments))
    assert isinstance(ran.exception, ConfigError)
    assert sentence in str(ran.exception)


def test_a_law_on_the_ground_over_a_radio_of_each_vehicles_own(tmp_path: Path) -> None:
    asked = ("--vehicles", "2", "--law-on", "ground", "--link", "loss 10% delay 10 ms")
    flown = _sweep(tmp_path, *asked, "--summary", str(tmp_path / "ground.json"))
    assert flown.exit_code == 0, flown.output
    numbers = _json(tmp_path / "ground.json")
    assert (numbers["law_on"], numbers["link"], numbers["landed_by_px4"]) == ("ground", "loss 10% delay 10 ms", 0)
    with np.load(tmp_path / "out" / "practical-seed1-ground-loss-10-delay-10-ms.npz", allow_pickle=False) as file:
        columns = dict(file)
    assert len(set(columns["link_delay_s"])) == 2
    assert (columns["link_delay_s"] >= 0.005).all() & (columns["link_delay_s"] <= 0.015).all()
    assert (columns["link_loss_share"] >= 0.05).all() & (columns["link_loss_share"] <= 0.15).all()
    assert numbers["uplink_bytes_per_s"] == pytest.approx(columns["link_bytes_per_s"].mean())
    assert "loss of the radio" in flown.output
    assert "landed by PX4: 0" in flown.output


def test_a_link_without_a_law_on_the_ground_is_refused(tmp_path: Path) -> None:
    refused = _sweep(tmp_path, "--link", "loss 10%")
    assert isinstance(refused.exception, ConfigError)
    assert str(refused.exception).startswith("--link 'loss 10%': there is no such link with the law on board")
