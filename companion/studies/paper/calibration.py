"""Calibration of the experiments' disturbances: PID's mean errors shall be those of the paper's PID.

`python -m companion.studies.paper.calibration ellipse figure8` flies PID alone and rewrites the disturbances
of config/experiments/: constant, noise and sinusoid of each axis by one factor, until its mean error over the seeds is
the paper's. Only then is ET-NN looked at (docs/experiments.md).
"""

import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.config.controller_config import load_controller
from companion.config.locations import project_root
from companion.config.text_files import read_text
from companion.core.interfaces import CompanionError
from companion.core.types import Array
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene, load_scene
from companion.simulation.simulation import simulate
from companion.studies.paper.paper_table import PAPER
from mock_autopilot.physics.disturbance import Forces

SEEDS = tuple(range(201, 211))
"""Not those that results are reported on."""
WITHIN = 0.02
_ROUNDS = 20
_EAGERNESS = 0.6
"""Less than 1: where dry friction holds the vehicle now and then, a little more force is a lot more error."""
_SECTIONS = re.compile(r"\[mock\.disturbance\].*\Z", re.DOTALL)
"""The disturbance is the file's last part."""


@dataclass(frozen=True)
class Calibrated:
    """The disturbance found, and PID's mean error under it."""

    forces: Forces
    error_m: Array


def pid_error_m(scene: Scene) -> Array:
    """Mean error of PID per axis, (3,), over the seeds."""
    controller = load_controller("pid", scene.vehicle_model(), scene.period_s)
    mission = stacked([scene.mission(controller.law.preview_s)] * len(SEEDS))
    return np.asarray(
        score(simulate(scene.pilot(controller), scene.vehicle(), mission, SEEDS)).mean_error_m.mean(axis=0)
    )


def calibrate(scene: Scene, wanted_m: Array) -> Calibrated:
    """Scale the axes until PID errs by `wanted_m` (3,); ValueError when it does not come that far."""
    forces = scene.mock.disturbance.forces()
    for _ in range(_ROUNDS):
        error = pid_error_m(_with(scene, forces))
        print(f"{scene.name}: PID errs by {np.round(error, 4)} m, wanted {wanted_m}", flush=True)
        if (np.abs(error / wanted_m - 1.0) < WITHIN).all():
            return Calibrated(forces, error)
        forces = scaled(forces, (wanted_m / error) ** _EAGERNESS)
    raise ValueError(f"{scene.name}: PID's error does not come within {WITHIN:.0%} of {wanted_m}")


def _with(scene: Scene, forces: Forces) -> Scene:
    fields = {name: getattr(forces, name) for name in Forces.__dataclass_fields__}
    disturbance = scene.mock.disturbance.model_copy(update=fields)
    return replace(scene, mock=scene.mock.model_copy(update={"disturbance": disturbance}))


def scaled(forces: Forces, factor: Array) -> Forces:
    """The forces, each axis times its factor, (3,), in round numbers."""

    def by_axis(values: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (float(f"{value * share:.3g}") for value, share in zip(values, factor.tolist(), strict=True))
        return x, y, z

    waves = tuple(replace(wave, amplitude_ned_n=by_axis(wave.amplitude_ned_n)) for wave in forces.sinusoids)
    return replace(
        forces, constant_ned_n=by_axis(forces.constant_ned_n), sinusoids=waves, noise_n=by_axis(forces.noise_n)
    )


def disturbance_toml(found: Calibrated) -> str:
    """Return the text of the experiment file's last part."""
    f = found.forces
    error = ", ".join(f"{value:.4f}" for value in found.error_m)
    lines = [
        "[mock.disturbance]                    # N, world axes NED; frozen: companion/studies/paper/calibration.py",
        f"constant_ned_n = {list(f.constant_ned_n)}   # PID errs by {error} m",
        f"noise_n = {list(f.noise_n)}",
        f"noise_time_s = {f.noise_time_s}",
    ]
    for wave in f.sinusoids:
        lines += ["", "[[mock.disturbance.sinusoids]]", f"amplitude_ned_n = {list(wave.amplitude_ned_n)}"]
        lines += [f"period_s = {wave.period_s}", f"phase_rad = {wave.phase_rad}"]
    return "\n".join(lines) + "\n"


def main(names: list[str]) -> None:
    """Calibrate the named experiments of config/experiments/ in place."""
    for name in names:
        if name not in PAPER:
            sys.exit(f"the paper has no experiment {name!r}: {', '.join(PAPER)}")
        path: Path = project_root() / "config" / "experiments" / f"{name}.toml"
        found = calibrate(load_scene(name), np.array(PAPER[name].pid.mean_m))
        text = _SECTIONS.sub(lambda _, found=found: disturbance_toml(found), read_text(path))  # type: ignore[misc]
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:] or list(PAPER))
    except (CompanionError, ValueError) as error:
        sys.exit(str(error))
