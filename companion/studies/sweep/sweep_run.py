"""A sweep on several workers: every finished batch is a file at once, and what is a file is not flown again."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.config.controller_config import ControllerFiles, load_controller, read_controller
from companion.simulation.compiled_flight import engine_of
from companion.simulation.kept_results import KeptResults
from companion.simulation.scene import Scene, load_scene
from companion.simulation.virtual_link import radio_named
from companion.simulation.workers import Backend, report, workers
from companion.studies.sweep.sweep import Batch, Columns, Sweep, fly, joined

_REPORT_EVERY = 50
"""Cycles between two reports of a batch's progress."""
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
    engine: str
    """Code that flies such a batch here, in words."""


@dataclass(frozen=True)
class Job:
    """A batch with all that flying it needs, for any computer."""

    batch: Batch
    scene: Scene
    controller: ControllerFiles


class Parts:
    """A sweep's batches as jobs, and the finished ones as files of a folder."""

    def __init__(self, sweep: Sweep, folder: Path, fresh: bool = False) -> None:
        self._kept, files = KeptResults(folder, fresh), read_controller(sweep.controller)
        scenes = {kind: _scene(*kind, sweep.link) for kind in sweep.kinds}
        for scene in scenes.values():
            self.law = load_controller(files, scene.vehicle_model(), scene.period_s).law
        self.jobs = [Job(batch, scenes[batch.experiment, batch.nominal_radps], files) for batch in sweep.batches()]

    @property
    def paths(self) -> list[Path]:
        """Files of the parts, finished or not."""
        return [self._kept.path(fly_job, job) for job in self.jobs]

    def read(self) -> dict[int, Columns]:
        """Return the finished batches, by the numbers of their jobs."""
        return self._kept.found(fly_job, self.jobs)

    @property
    def finished(self) -> int:
        """Vehicles whose part is there."""
        return sum(len(job.batch.indices) for job, path in zip(self.jobs, self.paths, strict=True) if path.is_file())


def run(sweep: Sweep, folder: Path, backend: Backend, fresh: bool, progress: Callable[[float], None]) -> Swept:
    """Fly what is not yet in the folder; `fresh` flies everything again. `progress` is told of vehicles flown so far.

    Raises ConfigError for a controller or an experiment that cannot be used, CompanionError when a worker process dies
    or the folder cannot be written to. A KeyboardInterrupt ends the workers; finished parts stay.
    """
    began_s = time.perf_counter()
    parts = Parts(sweep, folder, fresh)
    found = parts.read()
    taken_over = sum(len(columns["vehicle"]) for columns in found.values())
    on_ground = sweep.link is not None
    engine = "in Python (on the ground)" if on_ground else engine_of(parts.law, len(parts.jobs[0].batch.indices))
    progress(taken_over)
    with workers(backend, _ADVICE, folder, fresh) as crew:
        done = crew.in_order(fly_job, parts.jobs, lambda flown: progress(taken_over + flown))
    vehicle_s = sum(float(one["flight_s"].sum()) for number, one in enumerate(done) if number not in found)
    return Swept(joined(done), taken_over, time.perf_counter() - began_s, vehicle_s, engine)


def fly_job(job: Job) -> Columns:
    """Fly a batch, and report the vehicles flown so far."""
    batch, scene = job.batch, job.scene
    share = len(batch.indices) / round((scene.settle_s + scene.trajectory.duration_s) / scene.period_s)

    def progress(cycle: int) -> None:
        if (cycle + 1) % _REPORT_EVERY == 0:
            report((cycle + 1) * share)

    return fly(batch, scene, load_controller(job.controller, scene.vehicle_model(), scene.period_s), progress)


def _scene(experiment: str, nominal_radps: float, link: str | None) -> Scene:
    scene = load_scene(experiment).with_bandwidth(nominal_radps)
    return scene if link is None else scene.with_radio(radio_named(link))


def write_table(path: Path, columns: Columns) -> None:
    """A whole file or none: it gets its name when it is finished."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}")
    with unfinished.open("wb") as file:
        np.savez(file, **columns)  # type: ignore[arg-type]
    unfinished.replace(path)
