"""Flights in virtual time: repeatable to the last bit, the same alone and in a batch, and close to what flies."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from companion.config.arms_config import Feedforward
from companion.config.controller_config import LoadedController
from companion.control.horizon_correction import HorizonRules
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace, simulate
from companion.simulation.virtual_record import one_of
from companion.simulation.virtual_world import VirtualVehicle
from companion.studies.paper.ablations import Ablation, load_ablated
from companion.trajectories.reference import Ellipse, FigureEight, Hold, LapTiming, Trajectory
from mock_autopilot.px4.attitude_error import AttitudeErrorSamples
from tests.flights.command import ROOT
from tests.simulation.scenes import CENTRE, PUSHED, QUIET, law_for, scene

pytestmark = pytest.mark.slow

STANDING = Hold(CENTRE, duration_s=2.0)
SECOND = 100


def flown(
    scene: Scene, controller: LoadedController, seeds: list[int] | int = 1, vehicle: VirtualVehicle | None = None
) -> Trace:
    """One flight for a seed, a batch for a list of them."""
    mission = scene.mission(controller.law.preview_s)
    if isinstance(seeds, list):
        mission = stacked([mission] * len(seeds))
    pilot, world = scene.pilot(controller), vehicle or scene.vehicle()
    return simulate(pilot, world, mission, seeds if isinstance(seeds, list) else [seeds])


def digest() -> str:
    """Everything of a short flight with arms, noise and disturbance, in one number."""
    short = scene(Hold(CENTRE, duration_s=1.0), arms="swing", disturbance=PUSHED)
    law = law_for(short)
    trace = simulate(short.pilot(law), short.vehicle(), short.mission(law.law.preview_s), [5], keep_signals=True)
    columns = {
        name: value for name, value in vars(trace).items() if name not in {"signals", "messages"}
    } | trace.signals
    return hashlib.sha256(b"".join(value.tobytes() for _, value in sorted(columns.items()))).hexdigest()


def test_the_same_seed_gives_the_same_flight_to_the_last_bit_in_any_process() -> None:
    program = "from tests.simulation.test_simulation import digest; print(digest())"
    elsewhere = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert elsewhere.stdout.split() == [digest()]


def test_another_seed_gives_another_flight() -> None:
    short = scene(STANDING)
    one, two = (flown(short, law_for(short), seed) for seed in (1, 2))
    assert np.abs(one.position_w_m - two.position_w_m).max() > 1e-5


def alone_and_together(scene: Scene, controller: LoadedController) -> list[tuple[Trace, Trace]]:
    """For each of three seeds, its flight alone, and the batch cut down to it."""
    together, seeds = flown(scene, controller, [4, 5, 6]), (4, 5, 6)
    return [(flown(scene, controller, seed), one_of(together, row)) for row, seed in enumerate(seeds)]


@pytest.mark.parametrize("arms", ["off", "swing"])
def test_a_batch_without_a_trigger_flies_as_each_vehicle_would_alone(arms: str) -> None:
    short = scene(arms=arms, disturbance=PUSHED)
    law = load_ablated("etnn", short.companion.vehicle_model(), short.period_s, Ablation.TRIGGER)
    for alone, cut in alone_and_together(short, law):
        assert np.abs(alone.position_w_m - cut.position_w_m).max() < 1e-9
        assert (alone.sent == cut.sent).all()


def test_with_the_trigger_too_but_rounding_may_move_an_event_by_a_cycle() -> None:
    short = scene(disturbance=PUSHED)
    for alone, cut in alone_and_together(short, law_for(short)):
        assert np.abs(alone.position_w_m - cut.position_w_m)[:SECOND].max() < 1e-9
        assert score(cut).error_m == pytest.approx(score(alone).error_m, rel=0.05)
        assert score(cut).event_share == pytest.approx(score(alone).event_share, rel=0.1)


def test_lost_frames_are_lost_to_a_batch_as_to_one_vehicle() -> None:
    short = scene(disturbance=PUSHED)
    law = load_ablated("etnn", short.companion.vehicle_model(), short.period_s, Ablation.TRIGGER)
    unseen = np.zeros((len(short.mission(0.0).time_s), 2), dtype=bool)
    for begin in (150, 400, 640):
        unseen[begin : begin + 10, 1] = True
    together = flown(short, law, [4, 5], replace(short.vehicle(), unseen=unseen))
    for row, seed in enumerate((4, 5)):
        alone = flown(short, law, seed, replace(short.vehicle(), unseen=unseen[:, row]))
        assert np.abs(alone.position_w_m - together.position_w_m[:, row]).max() < 1e-9
    unhurt = flown(short, law, 5)
    assert np.abs(unhurt.position_w_m - together.position_w_m[:, 1])[:151].max() < 1e-9
    assert np.abs(unhurt.position_w_m - together.position_w_m[:, 1])[151:].max() > 1e-4
    assert score(together).max_error_m.max() < 0.3, "100 ms without motion capture are survived"


@pytest.mark.parametrize("source", ["random", "px4-a"])
def test_an_uncorrected_horizon_pushes_a_hover_off_as_far_as_recorded_and_where_it_leans(source: str) -> None:
    """Recorded: 0.009 to 0.016 m; the tilt's error and the position's half a second later correlate by 0.64 to 0.86.

    That was the first half minute of flights whose horizon erred by 0.7 degrees then, both axes together; here it errs
    by 1.7 from the start, and nothing else disturbs.
    """
    hover = scene(Hold(CENTRE, duration_s=20.0), qualisys=QUIET, estimator={"attitude_error_source": source})
    law, seeds = law_for(hover), [1, 2, 3, 4]
    pilot = replace(hover.pilot(law), horizon=HorizonRules(enabled=False))
    trace = simulate(pilot, hover.vehicle(), stacked([hover.mission(law.law.preview_s)] * len(seeds)), seeds)
    error_m = trace.error_w_m[3 * SECOND :]
    assert 0.009 < np.linalg.norm(error_m, axis=-1).mean() < 0.016 * 1.7 / 0.7
    for row, seed in enumerate(seeds):
        rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])
        tilt = AttitudeErrorSamples(hover.mock.estimator.attitude_error(), [rng], ()).more(800)
        leans = tilt[(3 * SECOND - SECOND // 2 + np.arange(len(error_m))) // 4]
        together = (error_m[:, row, 0] @ leans[:, 1] + error_m[:, row, 1] @ leans[:, 0]) / np.sqrt(
            (error_m[:, row, :2] ** 2).sum() * (leans**2).sum()
        )
        assert together > 0.64, "pitch too high is flown nose down, north; roll too high is flown to the left"


@pytest.mark.parametrize("name", ["etnn", "pid"])
def test_nothing_disturbs_a_hover_without_noise_and_disturbance(name: str) -> None:
    still = scene(STANDING, qualisys=QUIET)
    trace = flown(still, law_for(still, name))
    assert np.abs(trace.error_w_m).max() < 1e-6
    assert np.abs(trace.velocity_w_mps).max() < 1e-6


def test_the_law_that_flies_comes_back_from_half_a_metre() -> None:
    away = scene(Hold(CENTRE, duration_s=6.0))
    trace = flown(away, law_for(away), 1, replace(away.vehicle(), offset_w_m=np.array([0.3, -0.4, 0.1])))
    distance = np.linalg.norm(trace.error_w_m, axis=1)
    assert distance[0] == pytest.approx(np.sqrt(0.26))
    assert distance[-SECOND:].max() < 0.05


@pytest.mark.parametrize("curve", [Ellipse, FigureEight])
def test_the_law_that_flies_beats_the_baseline_on_every_axis_with_a_tenth_of_its_messages(
    curve: type[Ellipse] | type[FigureEight],
) -> None:
    trajectory: Trajectory = curve(CENTRE, timing=LapTiming(period_s=15.0, laps=1))
    lap = scene(trajectory, settle_s=4.0, disturbance=PUSHED)
    ours, baseline = (score(flown(lap, law_for(lap, name))) for name in ("etnn", "pid"))
    assert (ours.mean_error_m <= 0.02).all()
    assert (ours.max_error_m <= 0.08).all()
    assert (ours.mean_error_m < 0.3 * baseline.mean_error_m).all(), f"{ours.mean_error_m}, {baseline.mean_error_m}"
    assert ours.update_share <= 0.10
    assert baseline.event_share == 1.0


def test_arms_push_the_vehicle_and_what_the_law_is_told_of_them_takes_most_of_it_away() -> None:
    """On a hover, by the law without a trigger, whose events would hide it."""
    swinging, still = (scene(Hold(CENTRE, duration_s=8.0), arms, 4.0, qualisys=QUIET) for arms in ("swing", "off"))
    law = load_ablated("etnn", still.companion.vehicle_model(), still.period_s, Ablation.TRIGGER)
    mission = still.mission(law.law.preview_s)
    assert np.abs(simulate(still.pilot(law), still.vehicle(), mission, [1]).error_w_m).max() < 1e-6
    off, full = (
        score(simulate(swinging.pilot(law, told), swinging.vehicle(), mission, [1])).error_m
        for told in (Feedforward.OFF, Feedforward.FULL)
    )
    assert off > 0.01
    assert full < 0.5 * off


def test_the_law_as_printed_leaves() -> None:
    lap = scene(disturbance=PUSHED)
    result = score(flown(lap, law_for(lap, "paper", allow_unstable=True)))
    assert result.diverged
    assert not score(flown(lap, law_for(lap))).diverged


def test_what_is_kept_of_a_flight() -> None:
    short = scene(STANDING, arms="swing")
    law, seen = law_for(short), list[int]()
    mission = short.mission(law.law.preview_s)
    trace = simulate(short.pilot(law), short.vehicle(), mission, [1], keep_signals=True, progress=seen.append)
    count = len(mission.time_s)
    assert seen == list(range(count))
    assert {"y1", "y2", "iota1", "f_hat", "kappa"} <= set(trace.signals)
    assert {len(values) for values in trace.signals.values()} == {count}
    assert np.array_equal(trace.error_w_m, trace.position_w_m - trace.reference_w_m)
    assert flown(short, law).signals == {}
    held = [
        (b == a).all() for (a, b), event in zip(pairwise(trace.accel_w_mps2), trace.event[1:], strict=True) if not event
    ]
    assert held, "the trigger spared some updates"
    assert all(held), "between events the command is held"
