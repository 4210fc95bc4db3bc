"""Evaluation of many sets of gains as one batch: every set on several vehicles."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from companion.config.controller_config import ErrorLimits, LoadedController
from companion.core.types import Array
from companion.simulation.metrics import Score, score
from companion.simulation.mission import looking_ahead
from companion.simulation.scene import Scene
from companion.simulation.simulation import simulate
from companion.simulation.virtual_world import STEP_S
from companion.studies.sweep.sweep_vehicles import (
    BANDWIDTH_SHARE,
    DELAY_STEPS,
    DROPOUTS,
    HOVER_SHARE,
    Drawn,
    draw,
    vehicles,
)
from companion.studies.tuning.etnn_space import ETNN
from companion.studies.tuning.gain_space import GainSpace, values_of
from companion.trajectories.reference import Ellipse, FigureEight

WORST_M = 0.5
"""The error of a vehicle that diverged, and the most that any counts with."""


@dataclass(frozen=True)
class Trial:
    """One experiment on one attitude loop, for every set of gains: vehicles as configured, and some that are not."""

    scene: Scene
    """With its companion and its vehicle configured for that loop."""
    seed: int
    """Seed of everything random; vehicles of other indices differ."""
    told: tuple[int, ...]
    """Indices of vehicles that are as the companion is told, and begin in the right place."""
    others: tuple[int, ...]
    """Indices of vehicles that differ from it, as in a sweep; the first is as hard to hold as a sweep's can be."""
    space: GainSpace = ETNN


@dataclass(frozen=True)
class Job:
    """A trial of these points (P, knobs) of the gain space."""

    trial: Trial
    shares: Array


@dataclass(frozen=True)
class Marks:
    """Marks of each set of gains, (P,): means over the trial's vehicles. Errors are norms of the axis means."""

    error_m: Array
    """Error of the vehicles with the law's parameters, from the beginning of the trajectory."""
    other_m: Array
    """Error of the vehicles that differ, from the first instant, their offset included."""
    worst_m: Array
    """The largest of those."""
    update_share: Array
    """Update share of the vehicles as told: the share that a user sees."""


def evaluate_job(job: Job) -> Marks:
    """Fly a job's points, see `evaluate`."""
    return evaluate(job.trial, job.shares)


def evaluate(trial: Trial, shares: Array) -> Marks:
    """Fly every point (P, knobs) of the gain space on every vehicle of the trial."""
    scene, sets, told = trial.scene, len(shares), len(trial.told)
    drawn = drawn_vehicles(trial)
    values = values_of(shares, trial.space.knobs)
    each = {name: np.repeat(value, len(drawn.flight_seed)) for name, value in values.items()}
    law = trial.space.law_of(each, scene.vehicle_model(), scene.period_s)
    pilot = scene.pilot(LoadedController("candidate", law, ErrorLimits()))
    previews_s = np.broadcast_to(trial.space.previews_s(law), sets * len(drawn.flight_seed))
    mission = looking_ahead(scene.trajectory, previews_s, scene.settle_s, scene.period_s)
    vehicle = vehicles(scene, _tiled(drawn, sets), len(mission.time_s))
    trace = simulate(pilot, vehicle, mission, np.tile(drawn.flight_seed, sets).tolist())
    tracking, whole = score(trace), score(trace, -math.inf)
    shape = (sets, -1)
    error, other = _capped(tracking).reshape(shape)[:, :told], _capped(whole).reshape(shape)[:, told:]
    return Marks(
        error.mean(axis=1),
        other.mean(axis=1),
        other.max(axis=1),
        tracking.update_share.reshape(shape)[:, :told].mean(axis=1),
    )


def _capped(flown: Score) -> Array:
    return np.minimum(np.where(flown.diverged, math.inf, flown.error_m), WORST_M)


def drawn_vehicles(trial: Trial) -> Drawn:
    """A trial's vehicles: those as told first, then one that is hard to hold, then the others."""
    drawn = draw(trial.seed, (*trial.told, *trial.others))
    _make_hard(drawn, len(trial.told))
    same = _as_told(trial.scene, drawn.flight_seed[: len(trial.told)])
    return Drawn(
        **{
            name: np.concatenate((getattr(same, name), getattr(drawn, name)[len(trial.told) :]))
            for name in Drawn.__dataclass_fields__
        }
    )


def _make_hard(drawn: Drawn, vehicle: int) -> None:
    """The slowest attitude loop, the longest delays and rotors that give the most: where loops are lost first."""
    drawn.bandwidth_share[vehicle] = BANDWIDTH_SHARE[0]
    drawn.hover_share[vehicle] = HOVER_SHARE[0]
    drawn.mocap_delay_s[vehicle] = drawn.setpoint_delay_s[vehicle] = DELAY_STEPS[1] * STEP_S


def _as_told(scene: Scene, flight_seed: NDArray[np.uint64]) -> Drawn:
    count = len(flight_seed)
    one, nothing = np.ones(count), np.zeros((count, DROPOUTS))
    vehicle = scene.vehicle()
    return Drawn(
        flight_seed=flight_seed,
        mass_share=one,
        hover_share=one,
        bandwidth_share=one,
        mocap_delay_s=one * vehicle.mocap_delay_s,
        setpoint_delay_s=one * vehicle.attitude_delay_s,
        disturbance_scale=one,
        noise_scale=one,
        offset_w_m=np.zeros((count, 3)),
        dropout_s=nothing,
        dropout_begin=nothing,
        attitude_error_rad=one * vehicle.attitude_error.rms_rad,
        attitude_error_time_s=one * vehicle.attitude_error.time_s,
        radio_share=np.ones((count, 3)),
    )


def _tiled(drawn: Drawn, sets: int) -> Drawn:
    return Drawn(**{name: np.concatenate([getattr(drawn, name)] * sets) for name in Drawn.__dataclass_fields__})


def shortened(scene: Scene) -> Scene:
    """One lap and half the settling: what a search can afford."""
    curve = scene.trajectory
    if isinstance(curve, Ellipse | FigureEight):
        curve = replace(curve, timing=replace(curve.timing, laps=1))
    return replace(scene, trajectory=curve, settle_s=0.5 * scene.settle_s)
