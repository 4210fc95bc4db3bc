"""A sweep that takes a second: a short experiment without arms, a few vehicles."""

from pathlib import Path

from companion.studies.sweep.sweep import Sweep

EXPERIMENT = """
title = "a short ellipse"
settle_s = 0.5
arms = "off"
[trajectory]
curve = "ellipse"
semi_axes_m = [0.1, 0.05]
period_s = 3.5
laps = 1
ramp_s = 0.6
height_m = {height_m}
[companion.vehicle]
mass_kg = 4.0
hover_thrust = 0.4
[mock.disturbance]
constant_ned_n = [0.4, -0.3, 0.0]
noise_n = [0.2, 0.2, 0.2]
"""


def short_experiment(folder: Path, height_m: float = 1.2) -> str:
    """Its file, as the name of an experiment."""
    path = folder / "short.toml"
    path.write_text(EXPERIMENT.format(height_m=height_m), encoding="utf-8")
    return str(path)


def short_sweep(folder: Path, vehicles: int = 8, seed: int = 1, controller: str = "pid") -> Sweep:
    """On that experiment, in batches of two."""
    experiments = (short_experiment(folder),)
    return Sweep(vehicles=vehicles, seed=seed, controller=controller, experiments=experiments, batch_size=2)
