"""The search for gains: CMA-ES over the unit cube, once for every weight that updates have against errors."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from cmaes import CMA

from companion.core.types import Array
from companion.simulation.scene import Scene
from companion.simulation.workers import Workers
from companion.studies.tuning.etnn_space import ETNN
from companion.studies.tuning.gain_space import GainSpace
from companion.studies.tuning.tuning import Job, Marks, Trial, evaluate_job

ERROR_M, UPDATES = 0.010, 0.05
"""Goals, and the scale of both objectives."""
CHECK_SEED = 900_001
"""Seed of the vehicles that centres are checked on; those of training begin at a million."""
_KEPT_EVERY = 10
_LEAST_UPDATES = 0.001
"""A vehicle that is given up sends nothing: no merit."""


Point = tuple[float, float]
"""Update share and error (m)."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of a search: scenes, weights, generations, population."""

    scenes: tuple[Scene, ...]
    """Every experiment on every attitude loop; those of one loop follow each other."""
    loops: int
    """Number of attitude loops."""
    generations: int
    population: int
    weights: tuple[float, ...]
    """Weights of log(updates) against log(error): one search each."""
    seed: int
    told: int = 6
    """Vehicles as the companion is told."""
    others: int = 2
    """Vehicles that differ from it; new ones in every generation, all of them."""
    space: GainSpace = ETNN
    step: float = 0.04
    """Standard deviation of the first generation, in the unit cube."""

    def turn(self, generation: int) -> tuple[Scene, ...]:
        """Return the scenes of a generation: one experiment on each loop, in turn."""
        each = len(self.scenes) // self.loops
        return tuple(self.scenes[loop * each + (generation + loop) % each] for loop in range(self.loops))


@dataclass(frozen=True)
class Centre:
    """Centre of a search: the mean of its next candidates, in the gain space."""

    shares: Array
    weight: float
    generation: int
    """So many were over."""


@dataclass(frozen=True)
class Generation:
    """Result of a generation: medians over its sets of gains, of means over scenes and vehicles."""

    weight: float
    number: int
    error_m: float
    other_m: float
    """Error of the vehicles whose parameters differ from the law's."""
    update_share: float


def search(plan: Plan, start: Array, crew: Workers, told: Callable[[Generation, Array], None]) -> list[Centre]:
    """The centres that are worth a check: each run's after every tenth generation, and its last.

    Centres, not the best of what was tried: the best of many on three vehicles each is the luckiest. `told` gets every
    generation and the centre (knobs,) after it.
    """
    kept: list[Centre] = []
    for run, weight in enumerate(plan.weights):
        kept += _one_run(plan, start, weight, run, crew, told)
    return kept


def _one_run(
    plan: Plan, start: Array, weight: float, run: int, crew: Workers, told: Callable[[Generation, Array], None]
) -> list[Centre]:
    bounds = np.tile([0.0, 1.0], (len(plan.space.knobs), 1))
    optimiser = CMA(
        np.clip(start, 0.02, 0.98), plan.step, bounds=bounds, population_size=plan.population, seed=plan.seed + run
    )
    kept: list[Centre] = []
    for number in range(1, plan.generations + 1):
        points = np.array([optimiser.ask() for _ in range(plan.population)])
        trials = trials_of(plan.turn(number), training_seed(plan, run, number), (plan.told, plan.others), plan.space)
        marks = marks_of(trials, points, crew)
        costs = cost(marks, weight) + plan.space.penalty(points)
        optimiser.tell([(point, float(value)) for point, value in zip(points, costs, strict=True)])
        centre = np.clip(optimiser.mean, 0.0, 1.0)
        if number % _KEPT_EVERY == 0 or number == plan.generations:
            kept.append(Centre(centre, weight, number))
        told(_generation(weight, number, marks), centre)
    return kept


def training_seed(plan: Plan, run: int, generation: int) -> int:
    """A new one in every generation, so that none is learnt."""
    return 1_000_000 * (plan.seed + 1) + run * plan.generations + generation


def trials_of(scenes: Sequence[Scene], seed: int, vehicles: tuple[int, int], space: GainSpace) -> list[Trial]:
    """One trial a scene; `vehicles` is how many are as told, and how many are not."""
    told, others = vehicles
    return [Trial(scene, seed, tuple(range(told)), tuple(range(told, told + others)), space) for scene in scenes]


def marks_of(trials: Sequence[Trial], points: Array, crew: Workers) -> list[Marks]:
    """One entry a trial."""
    return crew.in_order(evaluate_job, [Job(trial, points) for trial in trials])


def cost(marks: Sequence[Marks], weight: float) -> Array:
    """log(error) + 0.5 log(error of other vehicles) + weight log(updates), mean over the scenes, (P,).

    Logarithms, so that a tenth less of each is worth the same everywhere.
    """
    error = np.mean([np.log(mark.error_m / ERROR_M) for mark in marks], axis=0)
    other = np.mean([np.log(mark.other_m / ERROR_M) for mark in marks], axis=0)
    updates = np.mean([np.log(np.maximum(mark.update_share, _LEAST_UPDATES) / UPDATES) for mark in marks], axis=0)
    return np.asarray(error + 0.5 * other + weight * updates)


def _generation(weight: float, number: int, marks: Sequence[Marks]) -> Generation:
    middle = (
        float(np.median(np.mean([getattr(mark, name) for mark in marks], axis=0)))
        for name in ("error_m", "other_m", "update_share")
    )
    return Generation(weight, number, *middle)


def front_of(points: Sequence[Point]) -> list[Point]:
    """Those that no other beats in both updates and error, by rising updates."""
    kept: list[Point] = []
    least = math.inf
    for updates, error_m in sorted(points):
        if error_m < least:
            least = error_m
            kept.append((updates, error_m))
    return kept


def scenes_of(scenes: Sequence[Scene], bandwidths_radps: Sequence[float]) -> tuple[Scene, ...]:
    """Every scene on every attitude loop."""
    return tuple(scene.with_bandwidth(radps) for radps, scene in product(bandwidths_radps, scenes))
