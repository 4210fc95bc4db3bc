"""A campaign: every law on every experiment, whole and with one part left out, several seeds each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config.arms_config import Feedforward
from companion.config.controller_config import (
    ControllerFiles,
    ErrorLimits,
    LoadedController,
    load_controller,
    read_controller,
)
from companion.control.law_check import in_flight
from companion.core.types import Array
from companion.simulation.link_numbers import LinkNumbers, link_numbers
from companion.simulation.metrics import Score, score
from companion.simulation.mission import stacked
from companion.simulation.scene import HorizonError, Scene, load_scene
from companion.simulation.simulation import Trace, simulate
from companion.studies.paper.ablations import Ablation, load_ablated, parts_of
from mock_autopilot.impairment.sentences import Directions

BASELINE = "pid"
"""Law that every reduction is relative to."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """One law on one experiment, one vehicle a seed; names as the user gives them."""

    experiment: str
    controller: str
    seeds: tuple[int, ...]
    bandwidth_radps: float | None = None
    """None: the experiment's own attitude loop."""
    horizon: HorizonError | None = None
    """Error of the autopilot's horizon; None: the experiment's own."""
    radio: Directions | None = None
    """Impairments of the link to a law on the ground; None: the law is on board."""
    without: Ablation | None = None
    feedforward: Feedforward | None = None
    """None: as the experiment configures it."""
    corrected: bool = True
    """False: the companion leaves the autopilot's horizon as it is."""
    allow_unstable: bool = False
    """True to fly a file that is refused as unstable."""

    @property
    def variant(self) -> str:
        """The difference from the complete law; empty for the complete law."""
        if self.without is not None:
            return f"without_{self.without}"
        if not self.corrected:
            return "horizon_uncorrected"
        return "" if self.feedforward is None else f"feedforward_{self.feedforward}"


@dataclass(frozen=True)
class Job:
    """An item with all that flying it needs, for any computer."""

    item: Item
    scene: Scene
    controller: ControllerFiles


@dataclass(frozen=True, kw_only=True)
class Flown:
    """Result of an item, over the cycles that fly the trajectory; B vehicles, in the order of the seeds."""

    item: Item
    score: Score
    events: Array
    """Number of events on each vehicle, (B,)."""
    gap_cycles: NDArray[np.int64]
    """Gaps between events, of all vehicles, (n,)."""
    period_s: float
    """Period of the control cycle."""
    limits: ErrorLimits
    link: LinkNumbers | None = None
    """Numbers of the link to a law on the ground."""

    @property
    def mean_error_m(self) -> Array:
        """Averaged over the vehicles, per axis of W (3,)."""
        return np.asarray(self.score.mean_error_m.mean(axis=0))

    @property
    def max_error_m(self) -> Array:
        """The largest error of each flight, averaged over the vehicles, per axis of W (3,)."""
        return np.asarray(self.score.max_error_m.mean(axis=0))

    @property
    def error_m(self) -> float:
        """Norm of the three axes' means."""
        return float(np.sqrt((self.mean_error_m**2).sum()))

    @property
    def update_share(self) -> float:
        """Share of the cycles that sent a setpoint."""
        return float(self.score.update_share.mean())

    @property
    def gap_s(self) -> tuple[float, float, float] | None:
        """Least, mean and largest time between events; None where there were not two of them."""
        gaps = self.gap_cycles
        if not gaps.size:
            return None
        return float(gaps.min()) * self.period_s, float(gaps.mean()) * self.period_s, float(gaps.max()) * self.period_s

    @property
    def diverged(self) -> int:
        """The number of vehicles that were lost."""
        return int(self.score.diverged.sum())

    @property
    def outside(self) -> int:
        """The number of vehicles outside the error limits of the controller's file."""
        small = (self.score.mean_error_m <= self.limits.mean_m) & (self.score.max_error_m <= self.limits.max_m)
        return int((~small.all(axis=-1)).sum())

    @property
    def good(self) -> bool:
        """None lost, and every one inside the error limits."""
        return self.diverged == 0 and self.outside == 0 and self.landed == 0

    @property
    def landed(self) -> int:
        """The number of vehicles that PX4 landed, as the law on the ground was not heard."""
        return int(self.score.landed.sum())


def label_of(name: str) -> str:
    """A controller or an experiment in tables and in JSON: its name, or that of its file."""
    return Path(name).stem if name.endswith(".toml") else name


@lru_cache(maxsize=8)
def _planned(experiment: str) -> Scene:
    """An experiment as it is in its file; the arms' way is planned once a process."""
    return load_scene(experiment)


@lru_cache(maxsize=8)
def _on_loop(experiment: str, bandwidth_radps: float | None) -> Scene:
    scene = _planned(experiment)
    return scene if bandwidth_radps is None else scene.with_bandwidth(bandwidth_radps)


def scene_of(item: Item) -> Scene:
    """Return an item's experiment, on the attitude loop and with the horizon that were asked for."""
    scene = _on_loop(item.experiment, item.bandwidth_radps)
    scene = scene if item.horizon is None else scene.with_horizon(item.horizon)
    scene = scene if item.corrected else scene.uncorrected()
    return scene if item.radio is None else scene.with_radio(item.radio)


def job_of(item: Item) -> Job:
    """Read what flying an item needs. Raises ConfigError for files that cannot be read."""
    return Job(item, scene_of(item), read_controller(item.controller))


def controller_of(job: Job) -> LoadedController:
    """An item's law for the vehicle of its scene. Raises ConfigError for what `load_controller` refuses."""
    item, vehicle, period_s = job.item, job.scene.vehicle_model(), job.scene.period_s
    if item.without is not None:
        return load_ablated(job.controller, vehicle, period_s, item.without)
    return load_controller(job.controller, vehicle, period_s, item.allow_unstable)


def fly(item: Item) -> Flown:
    """All vehicles of an item, side by side."""
    return fly_job(job_of(item))


def fly_job(job: Job) -> Flown:
    """All vehicles of a job's item, side by side."""
    item, scene = job.item, job.scene
    controller = controller_of(job)
    mission = stacked([scene.mission(controller.law.preview_s)] * len(item.seeds))
    pilot = scene.pilot(controller, item.feedforward)
    with in_flight(controller.own_file):
        trace = simulate(pilot, scene.vehicle(), mission, item.seeds)
    with np.errstate(over="ignore", invalid="ignore"):  # of a vehicle that was lost
        marks = score(trace)
    link = link_numbers([trace], scene.period_s)
    events = trace.event[tracking(trace)]
    gaps = np.concatenate([np.diff(np.flatnonzero(one)) for one in events.T])
    return Flown(
        item=item,
        score=marks,
        events=events.sum(axis=0).astype(float),
        gap_cycles=gaps,
        period_s=scene.period_s,
        limits=controller.error_limits,
        link=link,
    )


def tracking(trace: Trace) -> NDArray[np.bool_]:
    """Cycles in which the trajectory is flown, (n,)."""
    return np.asarray(trace.time_s >= -1e-9)


def whole_items(
    experiments: Sequence[str],
    controllers: Sequence[str],
    seeds: tuple[int, ...],
    bandwidth_radps: float | None,
    allow_unstable: bool = False,
    horizon: HorizonError | None = None,
) -> list[Item]:
    """Every law on every experiment; the baseline is always among them, and first."""
    laws = [BASELINE, *(name for name in controllers if name != BASELINE)]
    return [
        Item(
            experiment=experiment,
            controller=law,
            seeds=seeds,
            bandwidth_radps=bandwidth_radps,
            horizon=horizon,
            allow_unstable=allow_unstable,
        )
        for experiment in experiments
        for law in laws
    ]


def variants_of(item: Item) -> Iterator[Item]:
    """The same with one part left out, for every part that the law has; and with the other feed-forward
    and an uncorrected horizon.

    Raises ConfigError for what is wrong with scene or controller.
    """
    job = job_of(item)
    scene = job.scene
    controller_of(job)
    yield from (replace(item, without=part) for part in parts_of(job.controller))
    if scene.corrects:
        yield replace(item, corrected=False)
    arms = scene.companion.arms
    if scene.arms is not None and arms is not None:
        yield replace(item, feedforward=Feedforward.FULL if arms.feedforward is Feedforward.OFF else Feedforward.OFF)


def numbers_of(flown: Flown) -> dict[str, Any]:
    """For JSON; what is no number, as the errors of a vehicle that went to infinity, is null."""
    return {
        "mean_error_m": _listed(flown.mean_error_m),
        "max_error_m": _listed(flown.max_error_m),
        "worst_max_error_m": _listed(flown.score.max_error_m.max(axis=0)),
        "error_m": _plain(flown.error_m),
        "update_share": flown.update_share,
        "event_share": float(flown.score.event_share.mean()),
        "events": float(flown.events.mean()),
        "inter_event_s": dict(zip(("min", "mean", "max"), flown.gap_s or (None,) * 3, strict=True)),
        "diverged": flown.diverged,
        **({} if flown.link is None else {"link": flown.link.plain()}),
        "seeds": list(flown.item.seeds),
    }


def _listed(values: Array) -> list[float | None]:
    return [_plain(float(value)) for value in values]


def _plain(value: float) -> float | None:
    return value if np.isfinite(value) else None
