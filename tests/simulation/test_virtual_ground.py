"""Flights with the law on the ground, over a radio, in virtual time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.geometry.attitude import ThrustModel, setpoint_of_accel
from companion.guard.geofence import Fence
from companion.guard.guard import NO_AGE_LIMIT, AgeRange, Guard
from companion.guard.limits import Limits
from companion.simulation.link_numbers import link_numbers
from companion.simulation.metrics import score
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace, simulate, simulate_in_python
from companion.simulation.virtual_ground import HeldCommand
from companion.simulation.virtual_link import radio_named
from companion.simulation.virtual_record import one_of
from companion.trajectories.reference import Ellipse, LapTiming
from tests.control.test_pipeline import VEHICLE
from tests.simulation.scenes import CENTRE, PUSHED, law_for, scene

pytestmark = pytest.mark.slow

SHORT = scene(Ellipse(CENTRE, timing=LapTiming(period_s=4.0, laps=1, ramp_s=1.0)), disturbance=PUSHED)
SEEDS = (1, 2, 3, 4)


def over(sentence: str) -> Scene:
    return SHORT.with_radio(radio_named(sentence)) if sentence else SHORT


@cache
def flown(sentence: str, seeds: tuple[int, ...] = SEEDS) -> Trace:
    """Flights over this radio; on board without a sentence, in Python as those: the compiled flights of a batch are not
    numpy's to the last bit."""
    scene = over(sentence)
    law = law_for(scene)
    mission = scene.mission(law.law.preview_s)
    if len(seeds) > 1:
        mission = stacked([mission] * len(seeds))
    fly = simulate if sentence else simulate_in_python
    return fly(scene.pilot(law), scene.vehicle(), mission, seeds)


@pytest.mark.parametrize("seeds", [(1,), SEEDS])
def test_over_a_perfect_link_the_flight_is_that_of_a_law_on_board_to_the_last_bit(seeds: tuple[int, ...]) -> None:
    ground, board = flown("clean", seeds), flown("", seeds)
    for name in ("position_w_m", "velocity_w_mps", "accel_w_mps2", "event", "sent"):
        np.testing.assert_array_equal(getattr(ground, name), getattr(board, name))
    assert board.messages is None
    assert link_numbers([board], SHORT.period_s) is None


@pytest.mark.parametrize("sentence", ["delay 2 ms", "loss 10% jitter 20 ms"])
def test_the_radio_costs_little_error(sentence: str) -> None:
    """1.1 times as much over a clean radio, 1.5 times over a bad one."""
    ground, board = score(flown(sentence)), score(flown(""))
    most = 1.1 if sentence == "delay 2 ms" else 1.5
    assert ground.error_m.mean() < most * board.error_m.mean()
    assert not ground.landed.any()


def test_a_batch_flies_as_each_vehicle_would_alone() -> None:
    bad = "loss 30% burst 100 ms jitter 20 ms"
    together = flown(bad)
    alone, cut = flown(bad, (3,)), one_of(together, 2)
    assert np.abs(alone.position_w_m - cut.position_w_m)[:200].max() < 1e-9
    assert score(cut).error_m == pytest.approx(score(alone).error_m, rel=0.1)


def test_the_numbers_of_the_link_are_those_of_its_messages() -> None:
    trace = flown("loss 10% jitter 20 ms")
    numbers = link_numbers([one_of(trace, row) for row in range(len(SEEDS))], SHORT.period_s)
    assert numbers is not None
    assert numbers == link_numbers([trace], SHORT.period_s)
    flight_s = float((trace.time_s >= 0.0).sum()) * SHORT.period_s
    messages = numbers.events + numbers.beats + numbers.again
    assert numbers.messages_per_s == pytest.approx(messages / flight_s)
    assert 30.0 < numbers.messages_per_s < 45.0
    assert numbers.lost == pytest.approx(0.1 * messages, rel=0.2)
    assert numbers.age_ms.median == pytest.approx(10.0, abs=1.0)
    assert numbers.age_ms.p99 == pytest.approx(20.0, abs=0.5)
    events = trace.event[trace.time_s >= 0.0].sum() / len(SEEDS)
    assert numbers.events == pytest.approx(events), "every event is sent"


def test_a_vehicle_that_px4_lands_counts_until_then() -> None:
    trace = flown("off")
    numbers, marks = link_numbers([trace], SHORT.period_s), score(trace, float(trace.time_s[0]))
    assert numbers is not None
    assert numbers.landed_by_px4 == 4
    assert numbers.landed_s == pytest.approx([trace.time_s[26]] * 4)
    assert marks.landed.all()
    assert not marks.diverged.any()
    assert (marks.max_error_m < 0.05).all(), "what comes after it does not count"
    assert np.isnan(score(trace).error_m).all(), "it was landed before the trajectory"
    assert np.isfinite(score(flown("clean")).error_m).all()


def test_a_silent_ground_is_answered_as_by_the_guard() -> None:
    limits, model, ages = Limits(), ThrustModel(), AgeRange(0.12, 0.2)
    guard = Guard(limits, model, Fence((-4.5, -4.5), (4.5, 4.5, 3.5)), NO_AGE_LIMIT, ages)
    tilted = setpoint_of_accel(np.array([3.0, 1.0, 0.5]), 0.3, model)
    here = replace(VEHICLE, position_w_m=CENTRE)
    for silence_s in (0.0, 0.12, 0.14, 0.18, 0.3):
        last = tilted
        held = HeldCommand(tilted, model, limits, ages)
        ours = held.setpoint(np.array([silence_s]), last, 0.01)
        theirs = guard.check(tilted, last, here, 0.0, 0.01, silence_s).setpoint
        np.testing.assert_allclose(ours.q_w_flu_wxyz, theirs.q_w_flu_wxyz, atol=1e-12)
        assert float(ours.thrust) == pytest.approx(float(theirs.thrust), abs=1e-12)


def test_the_law_looks_further_ahead_by_the_age_of_its_commands() -> None:
    late, board = over("delay 12 ms"), SHORT
    assert late.up_age_s == pytest.approx(0.02)
    assert board.up_age_s == 0.0
    assert late.vehicle_model().mocap_age_s == pytest.approx(board.vehicle_model().mocap_age_s + 0.02)
    ahead, now = late.mission(0.1).ahead, board.mission(0.12).ahead
    np.testing.assert_allclose(ahead.position_w_m, now.position_w_m, atol=1e-12)
