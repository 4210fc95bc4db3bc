"""The simulation in virtual time against the flight loop itself, on the same flight."""

from dataclasses import replace

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.simulation.demo_scene import demo_scene
from companion.simulation.metrics import Score, score
from companion.simulation.mission import stacked
from companion.simulation.simulation import simulate
from companion.supervisor.flight_state import Phase
from mock_autopilot.config import MockConfig
from tests.flights.simulated import BRISK, Flight
from tests.flights.test_simulated_arms import ARMS, LAP, End, error_w_m, lap, mock_arms
from tests.mock_autopilot.bench import NO_GPS, PERFECT
from tests.simulation.scenes import PERFECT_HORIZON

pytestmark = pytest.mark.slow

SETTLE_S = 0.5
SEEDS = list(range(8))


def simulated() -> Score:
    """The same lap for each seed, by the same law with the same arms; no disturbance there, and none here."""
    config = CompanionConfig(arms=ARMS, flight=BRISK.model_copy(update={"settle_s": SETTLE_S}))
    mock = {
        "plant": {"mass_kg": 4.85, "max_thrust_n": 95.1},
        "estimator": PERFECT_HORIZON,
        "px4": {"params": NO_GPS},
        "arms": mock_arms(),
    }
    scene = replace(demo_scene("lap", LAP, "swing", config, MockConfig.from_dict(mock)), link_s=0.0)
    controller = load_controller("etnn", config.vehicle_model(), scene.period_s)
    mission = stacked([scene.mission(controller.law.preview_s)] * len(SEEDS))
    return score(simulate(scene.pilot(controller), scene.vehicle(), mission, SEEDS))


def update_share(flight: Flight) -> float:
    return float(np.mean([np.isfinite(tick.sent_s) for tick in flight.ticks if tick.flight.phase is Phase.TRACK]))


async def test_the_flight_loop_and_the_simulation_agree_on_every_axis() -> None:
    # Without the horizon's own error, which is another one in each flight and larger than what is compared.
    flight, seeds = await lap(estimator=PERFECT, end=End.HOLDS), simulated()
    mean_m, largest_m = (np.asarray(which(np.abs(error_w_m(flight)), axis=0)) for which in (np.mean, np.max))
    expected_m = seeds.mean_error_m.mean(axis=0)
    size_m = float(np.linalg.norm(expected_m))
    assert np.abs(mean_m - expected_m).max() < 0.15 * size_m, f"{mean_m} against {expected_m}"
    assert np.linalg.norm(mean_m) == pytest.approx(size_m, rel=0.12)
    assert np.linalg.norm(largest_m) == pytest.approx(np.linalg.norm(seeds.max_error_m.mean(axis=0)), rel=0.3)
    assert update_share(flight) == pytest.approx(seeds.update_share.mean(), rel=0.25)
