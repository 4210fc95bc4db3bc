"""Numbers of docs/split.md: what a flight without motion capture on the vehicle costs, in simulated time.

`python -m tests.flights.without_frames` flies every row with seeds 1 to 8 and prints the table; six minutes.
"""

import asyncio
import logging
import math
from dataclasses import dataclass

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.core.types import FlightMode
from companion.supervisor.flight_state import LandRequest, Phase, TrackRequest
from companion.trajectories.reference import Ellipse, LapTiming
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.simulated_ground import GroundSetup, ground_config
from tests.flights.test_simulated_flights import UP, ask, until, wait

SEEDS = range(1, 9)
BOARD = CompanionConfig(flight=BRISK)
UNCORRECTED = BOARD.model_copy(update={"control": BOARD.control.model_copy(update={"horizon_correction": False})})
LAP = Ellipse(np.array([0.0, 0.0, 1.2]), timing=LapTiming(period_s=12.0, laps=1))


@dataclass(frozen=True)
class Place:
    """Places of the law and of the frames."""

    name: str
    config: CompanionConfig
    ground: GroundSetup | None = None


PLACES = (
    Place("law on board", BOARD),
    Place("law on board, `control.horizon_correction = false`", UNCORRECTED),
    Place("law on the ground, `onboard_mocap = true`", ground_config(BOARD, onboard_mocap=True), GroundSetup()),
    Place("law on the ground, `onboard_mocap = false`", ground_config(BOARD, onboard_mocap=False), GroundSetup()),
)


async def flown(place: Place, script: list[Step], seed: int) -> Flight:
    """Fly a script."""
    return await fly(script, controller="practical", config=place.config, ground=place.ground, seed=seed)


async def tracking_error_m(place: Place, seed: int) -> float:
    """Return the mean distance from the reference on the ellipse, m."""
    track = [ask(TrackRequest(LAP, 2.0)), until(Phase.TRACK), until(Phase.HOLD)]
    flight = await flown(place, [*UP, *track, ask(LandRequest()), until(Phase.DISARMED)], seed)
    pairs = zip(flight.ticks, flight.truths_w_m, strict=True)
    return float(
        np.mean(
            [
                math.dist(truth, tick.reference.position_w_m)
                for tick, truth in pairs
                if tick.flight.phase is Phase.TRACK and tick.reference is not None
            ]
        )
    )


async def died(place: Place, tracking: bool, seed: int) -> tuple[float, float]:
    """Return how long after the last datagram PX4 was told to land, s, and the drift until the vehicle stood, m."""
    begun_s: list[float] = []

    def die(flight: Flight) -> bool:
        assert flight.ground is not None
        flight.ground.kill(flight.ground.ground)
        begun_s.append(flight.room.now_s())
        return True

    track = [ask(TrackRequest(LAP, 1.0)), until(Phase.TRACK), wait(2.0 + 0.7 * seed)] if tracking else [wait(4.0)]
    script = [*UP, *track, die, until(Phase.HANDED_OVER), until(Phase.DISARMED)]
    flight = await flown(place, script, seed)
    assert flight.ground is not None
    handed_s = next(tick.time_s for tick in flight.ticks if tick.flight.phase is Phase.HANDED_OVER)
    begin = next(n for n, tick in enumerate(flight.ticks) if tick.time_s >= begun_s[0])
    assert any(tick.status.mode is FlightMode.LAND for tick in flight.ticks)
    drift_m = math.dist(flight.truths_w_m[begin][:2], flight.truths_w_m[-1][:2])
    return handed_s - flight.ground.heard[-1][0], drift_m


def spread(values: list[float], form: str) -> str:
    """Return mean, smallest and largest."""
    return f"{format(np.mean(values), form)} ({format(min(values), form)} to {format(max(values), form)})"


async def main() -> None:
    """Fly and print."""
    logging.disable(logging.CRITICAL)
    print("| flight | mean error on the ellipse, m |\n| --- | --- |")
    for place in PLACES:
        errors_m = [await tracking_error_m(place, seed) for seed in SEEDS]
        print(f"| {place.name} | {spread(errors_m, '.3f')} |", flush=True)
    print("\n| ground law dies | PX4 told to land after, s | drift until it stands, m |\n| --- | --- | --- |")
    for place in PLACES[2:]:
        for what, tracking in (("hover", False), ("ellipse", True)):
            ends = [await died(place, tracking, seed) for seed in SEEDS]
            after, drift = (spread([end[n] for end in ends], ".2f") for n in (0, 1))
            print(f"| {what}, {place.name.split(', ')[1]} | {after} | {drift} |", flush=True)


if __name__ == "__main__":
    asyncio.run(main())
