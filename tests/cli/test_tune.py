import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from companion.cli.commands import app
from companion.config.controller_config import load_controller
from companion.control.controller import VehicleModel
from companion.core.interfaces import ConfigError
from tests.studies.short_experiments import short_experiment

pytestmark = pytest.mark.slow


def _tune(folder: Path, *arguments: str) -> Result:
    experiment = short_experiment(folder / "short.toml")
    return CliRunner().invoke(
        app,
        [
            *("tune", "--experiments", str(experiment), "--bandwidths", "10", "--jobs", "1", "--generations", "1"),
            *("--population", "4", "--weights", "0.8", "--out", str(folder / "out"), *arguments),
        ],
        env={"COLUMNS": "160"},
    )


def test_a_search_writes_a_controller_that_flies(tmp_path: Path) -> None:
    path, summary = tmp_path / "mine.toml", tmp_path / "summary.json"
    ran = _tune(tmp_path, "--write", str(path), "--summary", str(summary))
    assert ran.exit_code == 0, ran.output
    assert "the best of this search is " in ran.output
    assert "better than practical (worst case " in ran.output
    assert 'description = "the ET-NN law of mine.toml' in path.read_text(encoding="utf-8")
    load_controller(str(path), VehicleModel(), 0.01)
    numbers = json.loads(summary.read_text(encoding="utf-8"))
    assert numbers["checked"][0].keys() == {"error_m", "other_m", "worst_m", "update_share", "values"}
    assert (tmp_path / "out" / "front.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((tmp_path / "out" / "generations.json").read_text(encoding="utf-8"))) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--weights", "0.5,-1"], "--weights 0.5,-1: must be comma-separated numbers from 0.05 to 20"),
        (["--bandwidths", "ten"], "--bandwidths ten: must be comma-separated numbers from 2 to 40"),
        (["--start", "pid"], "law = 'pid': must be 'etnn' here"),
        (["--experiments", "elipse"], "unknown experiment 'elipse'"),
        (["--write", "{folder}"], "is a folder: give the name of a file"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_one_sentence(tmp_path: Path, arguments: list[str], said: str) -> None:
    ran = _tune(tmp_path, *[part.format(folder=tmp_path) for part in arguments])
    assert isinstance(ran.exception, ConfigError)
    assert said in str(ran.exception)
