import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.config.locations import project_root
from companion.core.interfaces import CompanionError, ConfigError
from companion.simulation.kept_results import KeptResults
from companion.simulation.workers import Backend
from companion.studies.sweep.sweep_run import Parts, fly_job, run
from tests.studies.sweep_rig import short_sweep

pytestmark = pytest.mark.slow


def test_what_is_finished_is_taken_up_and_the_rest_is_flown(tmp_path: Path) -> None:
    sweep, folder, told = short_sweep(tmp_path), tmp_path / "parts", list[float]()
    first = run(sweep, folder, Backend(2), False, told.append)
    assert first.taken_over == 0
    assert first.columns["vehicle"].tolist() == list(range(8))
    assert first.columns["nominal_radps"].tolist() == [12.0, 6.3] * 4
    assert told[0] == 0.0
    assert told == sorted(told)
    assert told[-1] <= 8.0

    gone, broken, *_ = parts = list(folder.iterdir())
    assert len(parts) == 4
    gone.unlink()
    broken.write_bytes(broken.read_bytes()[:-100])
    second = run(replace(sweep, vehicles=12), folder, Backend(1), False, told.append)
    assert second.taken_over == 4
    for name, column in first.columns.items():
        assert np.array_equal(column, second.columns[name][:8]), name
    assert len(list(folder.iterdir())) == 6


def test_a_fresh_run_takes_nothing_over(tmp_path: Path) -> None:
    sweep, folder = short_sweep(tmp_path, vehicles=1), tmp_path / "parts"
    [job] = Parts(sweep, folder).jobs
    KeptResults(folder).write(fly_job, job, {"vehicle": np.array([0]), "error_whole_m": np.array([77.0])})
    kept = run(sweep, folder, Backend(1), False, lambda _: None)
    assert (kept.taken_over, kept.columns["error_whole_m"].tolist()) == (1, [77.0])
    flown = run(sweep, folder, Backend(1), True, lambda _: None)
    assert flown.taken_over == 0
    assert flown.columns["error_whole_m"][0] < 0.5
    again = run(sweep, folder, Backend(1), False, lambda _: None)
    assert again.columns["error_whole_m"] == flown.columns["error_whole_m"]


def test_parts_of_another_configuration_are_not_taken(tmp_path: Path) -> None:
    controller = tmp_path / "mine.toml"
    controller.write_text((project_root() / "config" / "controllers" / "pid.toml").read_text(encoding="utf-8"))
    sweep = short_sweep(tmp_path, controller=str(controller))
    folder = tmp_path / "parts"

    def paths() -> set[Path]:
        return set(Parts(sweep, folder).paths)

    before = paths()
    assert before == paths()
    for other in (
        replace(sweep, seed=2),
        replace(sweep, controller="practical"),
        replace(sweep, batch_size=1),
        replace(sweep, nominals_radps=(12.1, 6.4)),
        replace(sweep, experiments=("ellipse",)),
    ):
        assert before.isdisjoint(Parts(other, folder).paths), other
    controller.write_text(controller.read_text(encoding="utf-8").replace("1.6495", "1.6501"), encoding="utf-8")
    assert before.isdisjoint(paths())
    before = paths()
    experiment = Path(sweep.experiments[0])
    experiment.write_text(experiment.read_text(encoding="utf-8").replace("1.2", "1.3"), encoding="utf-8")
    assert before.isdisjoint(paths())


def test_the_file_of_a_law_of_ones_own_counts(tmp_path: Path) -> None:
    for name in ("sliding_mode.toml", "sliding_mode.py"):
        example = project_root() / "examples" / "own_law" / name
        (tmp_path / name).write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
    sweep = short_sweep(tmp_path, controller=str(tmp_path / "sliding_mode.toml"))
    before = set(Parts(sweep, tmp_path).paths)
    with (tmp_path / "sliding_mode.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert before.isdisjoint(Parts(sweep, tmp_path).paths)


_SCRIPT = """
import sys
from pathlib import Path
from companion.simulation.kept_results import KeptResults
from companion.simulation.workers import Backend
from companion.studies.sweep.sweep_run import run
from tests.studies.sweep_rig import short_sweep
if __name__ == "__main__":
    folder = Path(sys.argv[1])
    run(short_sweep(folder, vehicles=200), folder / "parts", Backend(1), False, lambda _: None)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_leaves_whole_parts_and_no_processes(tmp_path: Path, number: signal.Signals) -> None:
    parts = tmp_path / "parts"
    process = subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, str(tmp_path)], cwd=project_root(), stderr=subprocess.PIPE, text=True
    )
    while not list(parts.glob("*.part")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(number)
    process.communicate()  # every process that holds the pipe has ended
    assert process.returncode != 0
    kept = Parts(short_sweep(tmp_path, vehicles=200), parts).finished
    assert 2 <= kept < 200
    found = Parts(short_sweep(tmp_path, vehicles=200), parts)
    assert [len(columns["vehicle"]) for columns in found.read().values()] == [2] * (kept // 2)


@pytest.mark.parametrize(
    ("controller", "sentence"), [("lqr", "unknown controller 'lqr'"), ("paper", "must be larger than k \\+ s")]
)
def test_a_controller_that_cannot_be_flown_is_said_before_the_work(
    tmp_path: Path, controller: str, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        run(short_sweep(tmp_path, controller=controller), tmp_path / "parts", Backend(1), False, lambda _: None)


def test_a_folder_that_cannot_be_written_to_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "parts").write_text("a file", encoding="utf-8")
    with pytest.raises(CompanionError, match=r"cannot write to .*parts"):
        run(short_sweep(tmp_path, vehicles=1), tmp_path / "parts", Backend(1), False, lambda _: None)
