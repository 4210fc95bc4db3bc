"""Studies on a dask cluster: two processes of this computer, and a scheduler as any other."""

import builtins
import json
import operator
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster
from typer.testing import CliRunner, Result

import companion.cli.studies.sweep as command
from companion.cli.commands import app
from companion.config.locations import project_root
from companion.core.interfaces import CompanionError, ConfigError
from companion.simulation import cluster as module
from companion.simulation.build import this_build
from companion.simulation.workers import Backend, report, workers
from companion.studies.sweep.sweep import Columns, Sweep
from companion.studies.sweep.sweep_run import Parts, fly_job, run
from tests.control.first_law import FAILING_LINE, failing_law
from tests.simulation.cluster_rig import Deadly, fly_deadly
from tests.studies.short_experiments import short_experiment as short_flight
from tests.studies.sweep_rig import short_experiment, short_sweep

pytestmark = pytest.mark.slow

ADVICE = "try again"


@pytest.fixture(scope="module")
def _two() -> Iterator[LocalCluster]:
    few = dask.config.set({"distributed.scheduler.allowed-failures": 1})  # a start of a worker takes half a second
    with few, LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        yield cluster


@pytest.fixture
def scheduler(_two: LocalCluster) -> str:
    """HOST:PORT of a scheduler with two workers: those that the test before has killed are there again."""
    _two.wait_for_workers(2, timeout=60)
    return str(_two.scheduler_address.removeprefix("tcp://"))


def _equal(one: Columns, other: Columns) -> bool:
    assert one.keys() == other.keys()
    return all(one[name].tobytes() == other[name].tobytes() for name in one)


def _table(path: Path) -> Columns:
    with np.load(path) as arrays:
        return dict(arrays)


def _typed(name: str, *arguments: object) -> Result:
    return CliRunner().invoke(app, [name, *map(str, arguments)], env={"COLUMNS": "160"})


def _json(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return data


def test_a_sweeps_summary_is_the_same_to_the_last_bit(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = partial(Sweep, experiments=(short_experiment(tmp_path),), batch_size=2)
    monkeypatch.setattr(command, "Sweep", short)
    monkeypatch.setattr("companion.studies.sweep.sweep_plots.plot_sweep", lambda *_: None)
    summaries = []
    for place in (("--jobs", "1"), ("--on", f"dask://{scheduler}")):
        out, file = tmp_path / place[0], tmp_path / f"{place[0]}.json"
        ran = _typed("sweep", "--vehicles", 8, *place, "--out", out, "--summary", file)
        assert ran.exit_code == 0, ran.output
        summaries.append(_json(file))
    here, there = summaries
    assert there["taken_over"] == 0
    assert here | {"seconds": 0} == there | {"seconds": 0}
    assert _equal(*(_table(tmp_path / name / "practical-seed1.npz") for name in ("--jobs", "--on")))


def test_experiments_and_a_search_are_the_same_to_the_last_bit(scheduler: str, tmp_path: Path) -> None:
    flight = short_flight(tmp_path / "short.toml")
    flown = ("--experiments", flight, "--controllers", "practical", "--seeds", "4:5", "--no-report", "--no-ablations")
    searched = ("--experiments", flight, "--bandwidths", 10, "--generations", 1, "--population", 4, "--weights", 0.8)
    for name, asked in (("experiments", flown), ("tune", searched)):
        files = []
        for place in (("--jobs", "1"), ("--on", f"dask://{scheduler}")):
            files.append(tmp_path / f"{name}{place[0]}.json")
            ran = _typed(name, *asked, *place, "--out", tmp_path / f"{name}{place[0]}", "--summary", files[-1])
            assert ran.exit_code == 0, ran.output
        assert files[0].read_bytes() == files[1].read_bytes(), name


def test_a_law_of_ones_own_travels_as_text(scheduler: str, tmp_path: Path) -> None:
    """The files are gone before a worker could read them."""
    for name in ("sliding_mode.toml", "sliding_mode.py"):
        text = (project_root() / "examples" / "own_law" / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text, encoding="utf-8")
    sweep = short_sweep(tmp_path, vehicles=2, controller=str(tmp_path / "sliding_mode.toml"))
    jobs = Parts(sweep, tmp_path).jobs
    here = [fly_job(job) for job in jobs]
    for path in (*tmp_path.glob("*.py"), *tmp_path.glob("*.toml")):
        path.unlink()
    with workers(Backend(scheduler=scheduler), ADVICE) as crew:
        there = crew.in_order(fly_job, jobs)
    assert all(map(_equal, here, there))


def test_a_law_that_raises_on_a_worker_is_the_same_sentence(scheduler: str, tmp_path: Path) -> None:
    sweep = short_sweep(tmp_path, vehicles=1, controller=str(failing_law(tmp_path)))
    with pytest.raises(ConfigError) as raised:
        run(sweep, tmp_path / "parts", Backend(scheduler=scheduler), False, lambda _: None)
    assert str(raised.value) == f"{tmp_path / 'pd.py'}: raised in flight: KeyError: 'none' (line {FAILING_LINE})"


def test_progress_comes_from_inside_the_jobs(scheduler: str) -> None:
    told: list[float] = []
    with workers(Backend(scheduler=scheduler), ADVICE) as crew:
        for _ in range(200):  # what a job reports and what it returns take two ways
            crew.in_order(report, [2.0, 5.0], told.append)
            if max(told) >= 7.0:
                break
    assert max(told) >= 7.0


def test_a_worker_that_is_killed_at_work_costs_no_result(scheduler: str, tmp_path: Path) -> None:
    jobs = Parts(short_sweep(tmp_path, vehicles=6, controller="practical"), tmp_path).jobs
    marks = [tmp_path / "killed", *(Path("/") for _ in jobs[1:])]
    deadly = [Deadly(job, mark) for job, mark in zip(jobs, marks, strict=True)]
    with workers(Backend(scheduler=scheduler), ADVICE) as crew:
        there = crew.in_order(fly_deadly, deadly)
    assert marks[0].exists(), "a process was killed"
    assert all(_equal(fly_job(job), columns) for job, columns in zip(jobs, there, strict=True))


def test_a_job_that_kills_every_worker_is_one_sentence(scheduler: str) -> None:
    with (
        pytest.raises(CompanionError, match=r"several workers ended on their own at the same job .*: try again$"),
        workers(Backend(scheduler=scheduler), ADVICE) as crew,
    ):
        crew.in_order(os._exit, [1])


def test_nobody_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for port in (silent.getsockname()[1], 9):
            ran = _typed("sweep", "--on", f"dask://127.0.0.1:{port}", "--vehicles", 1)
            assert isinstance(ran.exception, ConfigError)
            assert str(ran.exception) == (
                f"--on dask://127.0.0.1:{port}: no dask scheduler answers there: start one with `dask scheduler` on "
                "that computer, or correct the address"
            )


def test_a_cluster_without_workers_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_WORKERS_S", 0.5)
    with (
        LocalCluster(n_workers=0, processes=True, dashboard_address=":0") as empty,
        pytest.raises(ConfigError, match=r"the cluster has no workers: start some with `dask worker 127"),
        workers(Backend(scheduler=empty.scheduler_address.removeprefix("tcp://")), ADVICE),
    ):
        pass


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        ({"source": "abc"}, r"the worker at tcp://.* has companion of other source \(.*, not abc\), so results would"),
        (
            {"numpy": "1.0"},
            r"has numpy 2.*, not 1.0, so results would not be the same: install the same on all",
        ),
        ({"engine": "magic"}, r"the worker at tcp://.* flies with (Python alone|the compiled law), not with magic, so"),
        ({"arithmetic": ""}, "rounds in another way: its processor or C library is of another kind"),
    ],
)
def test_workers_of_another_build_are_refused(
    scheduler: str, monkeypatch: pytest.MonkeyPatch, other: dict[str, str], sentence: str
) -> None:
    mine = replace(this_build(), **other)
    real = this_build
    with Client(f"tcp://{scheduler}", set_as_default=False) as client:
        monkeypatch.setattr(module, "_builds", lambda _: client.run(real))
        monkeypatch.setattr(module, "this_build", lambda: mine)
        with pytest.raises(ConfigError, match=sentence), workers(Backend(scheduler=scheduler), ADVICE):
            pass
        monkeypatch.setattr(module, "_check", lambda *_: None)
        with pytest.raises(ConfigError), workers(Backend(scheduler=scheduler), ADVICE) as late:
            late.in_order(operator.neg, [1.0])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--on", "tcp://a:8786"), "--on tcp://a:8786: must be dask://HOST:PORT, the address of a dask scheduler"),
        (("--on", "dask://"), "--on dask://: must be dask://HOST:PORT, the address of a dask scheduler"),
        (("--on", "dask://a:b"), "--on dask://a:b: must be dask://HOST:PORT, the address of a dask scheduler"),
        (
            ("--on", "dask://a", "--jobs", "2"),
            "--on dask://a: the cluster has its own number of processes: leave --jobs 2 out",
        ),
    ],
)
@pytest.mark.parametrize("name", ["sweep", "experiments", "tune"])
def test_an_address_that_is_none_is_one_sentence(name: str, arguments: tuple[str, ...], sentence: str) -> None:
    ran = _typed(name, *arguments)
    assert isinstance(ran.exception, ConfigError)
    assert str(ran.exception) == sentence


def test_without_the_package_the_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.partition(".")[0] == "distributed":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.delitem(sys.modules, "companion.simulation.cluster")
    monkeypatch.setattr(builtins, "__import__", without)
    with (
        pytest.raises(ConfigError, match=r"install it with pip install 'dauam-companion\[cluster\]'"),
        workers(Backend(scheduler="127.0.0.1:8786"), ADVICE),
    ):
        pass


def test_a_lost_scheduler_loses_no_finished_part(tmp_path: Path) -> None:
    """The scheduler is killed when the first part is there; the same sweep, here or there, goes on from it."""
    file, parts = tmp_path / "scheduler.json", tmp_path / "parts"
    common = {"cwd": project_root(), "stderr": subprocess.DEVNULL}
    here = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file)]
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *here]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", *here[2:]]
    scheduler = subprocess.Popen(dask, **common)  # type: ignore[call-overload]
    try:
        crew = subprocess.Popen(worker, **common)  # type: ignore[call-overload]
        with Client(scheduler_file=str(file), set_as_default=False, timeout=60) as client:
            client.wait_for_workers(1)
            address = client.scheduler.address.removeprefix("tcp://")

        def kill(flown: float) -> None:
            if flown > 0.0 and list(parts.glob("*.part")):
                os.kill(scheduler.pid, signal.SIGKILL)

        sweep = short_sweep(tmp_path, vehicles=40)
        with pytest.raises(CompanionError, match="the connection to the scheduler is lost: what is flown is kept"):
            run(sweep, parts, Backend(scheduler=address), False, kill)
    finally:
        for process in (crew, scheduler):
            process.kill()
            process.wait()
    kept = len(list(parts.glob("*.part")))
    assert 0 < kept < 20
    assert len(Parts(sweep, parts).read()) == kept
