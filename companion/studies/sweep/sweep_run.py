"""A sweep on several processes: every finished batch is a file at once, and what is a file is not flown again."""

import hashlib
import os
import time
import zipfile
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

import numpy as np

import companion
import mock_autopilot
from companion.compiled.library import library
from companion.config.controller_config import LoadedController, controller_path, load_controller
from companion.config.law_files import is_law_file, law_path
from companion.config.locations import project_root
from companion.config.toml_files import read_toml
from companion.core.interfaces import CompanionError
from companion.simulation.radio import radio_named
from companion.simulation.scene import Scene, load_scene
from companion.simulation.workers import SPAWN, workers
from companion.studies.sweep.sweep import Batch, Columns, Sweep, fly, joined

_POLL_S = 0.2
_REPORT_EVERY = 50
"""Cycles between two reports of a worker's progress."""
_ADVICE = "what is flown is kept, the same command goes on from there; try fewer --jobs"


@dataclass(frozen=True)
class Swept:
    """Result of a sweep's run."""

    columns: Columns
    taken_over: int
    """Vehicles that an earlier run had flown."""
    seconds: float
    """Duration of this run."""
    vehicle_seconds: float
    """Virtual time that this run flew, over all vehicles."""


class Parts:
    """A sweep's finished batches as files of a folder.

    A part's name holds a digest of all that its numbers depend on: batch, numpy, the source of simulator and law, the
    files of config/ and those of controller and experiments. What is of another configuration is never taken.
    """

    def __init__(self, sweep: Sweep, folder: Path) -> None:
        common = _digest_of_files(sweep)
        self.path = {batch: folder / f"{_digest(common, repr(batch))}.npz" for batch in sweep.batches()}

    def read(self, batch: Batch) -> Columns | None:
        """A finished batch; None if it is not there or cannot be read."""
        try:
            with self.path[batch].open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                return dict(file)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    @property
    def finished(self) -> int:
        """Vehicles whose part is there."""
        return sum(len(batch.indices) for batch, path in self.path.items() if path.is_file())


def run(sweep: Sweep, folder: Path, jobs: int, fresh: bool, progress: Callable[[float], None]) -> Swept:
    """Fly what is not yet in the folder; `fresh` flies everything again. `progress` is told of vehicles flown so far.

    Raises ConfigError for a controller or an experiment that cannot be used, CompanionError when a worker process dies
    or the folder cannot be written to. A KeyboardInterrupt ends the workers; finished parts stay.
    """
    began_s = time.perf_counter()
    for experiment, nominal_radps in sweep.kinds:
        _prepared(experiment, nominal_radps, sweep.controller, sweep.link)
    parts = Parts(sweep, folder)
    found = {} if fresh else {batch: parts.read(batch) for batch in parts.path}
    done = {batch: columns for batch, columns in found.items() if columns is not None}
    taken_over = sum(len(batch.indices) for batch in done)
    missing = {batch: path for batch, path in parts.path.items() if batch not in done}
    progress(taken_over)
    if missing:
        done |= _fly_all(missing, jobs, lambda flown: progress(taken_over + flown))
    vehicle_s = sum(float(done[batch]["flight_s"].sum()) for batch in missing)
    return Swept(joined(list(done.values())), taken_over, time.perf_counter() - began_s, vehicle_s)


def _fly_all(paths: dict[Batch, Path], jobs: int, progress: Callable[[float], None]) -> dict[Batch, Columns]:
    flown = SPAWN.Value("d", 0.0)
    with workers(min(jobs, len(paths)), _ADVICE, _begin_worker, (flown,)) as pool:
        futures = {pool.submit(_fly_part, batch, path): batch for batch, path in paths.items()}
        _wait(set(futures), lambda: progress(flown.value))
    return {batch: future.result() for future, batch in futures.items()}


def _wait(pending: set[Future[Columns]], progress: Callable[[], None]) -> None:
    """Until all are finished or one has failed."""
    while pending:
        finished, pending = wait(pending, _POLL_S, FIRST_COMPLETED)
        progress()
        for future in finished:
            future.result()


class _Worker:
    """Data that a worker process receives from its parent."""

    flown: "Synchronized[float]"


def _begin_worker(flown: "Synchronized[float]") -> None:
    _Worker.flown = flown


def _fly_part(batch: Batch, path: Path) -> Columns:
    """In a worker: fly a batch and leave it as a file."""
    scene, controller = _prepared(batch.experiment, batch.nominal_radps, batch.controller, batch.link)
    share = len(batch.indices) / round((scene.settle_s + scene.trajectory.duration_s) / scene.period_s)

    def progress(cycle: int) -> None:
        if (cycle + 1) % _REPORT_EVERY == 0:
            with _Worker.flown.get_lock():
                _Worker.flown.value += _REPORT_EVERY * share

    columns = fly(batch, scene, controller, progress)
    try:
        write_part(path, columns)
    except OSError as error:
        raise CompanionError(f"cannot write to {path.parent}: {error.strerror}") from None
    return columns


@lru_cache(maxsize=1)
def _prepared(
    experiment: str, nominal_radps: float, controller: str, link: str | None
) -> tuple[Scene, LoadedController]:
    scene = load_scene(experiment).with_bandwidth(nominal_radps)
    if link is not None:
        scene = scene.with_radio(radio_named(link))
    return scene, load_controller(controller, scene.vehicle_model(), scene.period_s)


def write_part(path: Path, columns: Columns) -> None:
    """A whole file or none: it gets its name when it is finished."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}")
    with unfinished.open("wb") as file:
        np.savez(file, **columns)  # type: ignore[arg-type]
    unfinished.replace(path)


def _digest(*pieces: str | bytes) -> str:
    whole = hashlib.sha256()
    for piece in pieces:
        data = piece.encode() if isinstance(piece, str) else piece
        whole.update(len(data).to_bytes(8, "big") + data)
    return whole.hexdigest()[:24]


def _digest_of_files(sweep: Sweep) -> str:
    """Return a digest of all inputs of a part but the batch; files count by content, not by path."""
    packages = [Path(package.__file__).parent for package in (companion, mock_autopilot) if package.__file__]
    files = [file for package in packages for file in sorted(package.rglob("*.py"))]
    files += [file for file in sorted((project_root() / "config").rglob("*")) if file.is_file()]
    files += [path for name in sweep.experiments if (path := Path(name)).is_file()]
    engine = "Python" if library() is None else "compiled"
    return _digest(np.__version__, engine, *(file.read_bytes() for file in files + _controller_files(sweep.controller)))


def _controller_files(name: str) -> list[Path]:
    """The controller's own file, and that of a law of one's own."""
    path = controller_path(name)
    law = read_toml(path).get("law")
    return [path, law_path(str(law), path)] if is_law_file(law) else [path]
