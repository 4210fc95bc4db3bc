"""Speed of virtual time: one flight, and a sweep on all processors with its draws and its summary."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from companion.compiled.library import library, side_by_side
from companion.config.controller_config import load_controller
from companion.simulation.scene import load_scene
from companion.simulation.simulation import simulate
from companion.simulation.workers import Backend
from companion.studies.sweep.sweep import Sweep
from companion.studies.sweep.sweep_run import run

EXPERIMENT, LAW = "ellipse", "practical"


@dataclass(frozen=True, kw_only=True)
class VirtualCost:
    """Speed of one flight and of a sweep."""

    compiled: bool
    """False where there is no compiled law: Python flew."""
    side_by_side: int
    """Vehicles that fly at once in a core's vectors."""
    command_s: float
    """Processor time of `companion simulate`, least of some runs."""
    times_real: float
    """One flight's virtual time over its processor time, median; what is prepared once for all flights is not in it."""
    processes: int
    vehicles: int
    vehicle_s_per_minute: float
    """Of the sweep, over all processes, their start included."""


def measure_virtual(flights: int, vehicles: int, say: Callable[[str], None]) -> VirtualCost:
    """Fly some flights one by one, then a sweep in a folder of its own."""
    say("one flight")
    times_real = _one(flights)
    say("companion simulate")
    command_s = min(_command() for _ in range(3))
    say(f"a sweep of {vehicles} vehicles")
    processes = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        sweep = Sweep(vehicles=vehicles, seed=1, controller=LAW)
        swept = run(sweep, Path(folder), Backend(processes), True, lambda _: None)
    rate = 60.0 * swept.vehicle_seconds / swept.seconds
    wide = side_by_side()
    return VirtualCost(
        compiled=library() is not None,
        side_by_side=1 if wide is None else wide.width(),
        command_s=command_s,
        times_real=times_real,
        processes=processes,
        vehicles=vehicles,
        vehicle_s_per_minute=rate,
    )


def _command() -> float:
    """Return the processor time of one flight by the command, Python's start included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", "from companion.cli.main import main; main()", "simulate", EXPERIMENT]
    subprocess.run(command, check=False, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def _one(flights: int) -> float:
    scene = load_scene(EXPERIMENT)
    law = load_controller(LAW, scene.vehicle_model(), scene.period_s)
    pilot, vehicle, mission = scene.pilot(law), scene.vehicle(), scene.mission(law.law.preview_s)
    took_s = []
    for seed in range(flights):
        began_s = time.process_time()
        simulate(pilot, vehicle, mission, [seed])
        took_s.append(time.process_time() - began_s)
    return len(mission.time_s) * pilot.period_s / median(took_s)
