"""One flight by a law on the ground, in simulated time over a radio that loses, recorded on both sides."""

import asyncio
from dataclasses import dataclass
from pathlib import Path

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_text
from companion.flight.assembly import controller_of, with_link
from companion.ground.ground_record import tick_of
from tests.analysis.recorded import recorded
from tests.flights.simulated import BRISK, Flight, fly
from tests.flights.simulated_ground import GroundSetup, ground_config
from tests.flights.test_simulated_flights import DOWN, UP, wait

CONFIG = ground_config(CompanionConfig(flight=BRISK), onboard_mocap=True)
RADIO = GroundSetup(link="loss 20% delay 3 ms jitter 5 ms")


@dataclass(frozen=True)
class BothSides:
    """Flight, and its two records."""

    flight: Flight
    vehicle: Path
    ground: Path


def _to_pid(flight: Flight) -> bool:
    assert flight.ground is not None
    law = flight.ground.ground.law
    law.switch("pid", controller_of(with_link(CONFIG, law.made_for_s), "pid").law)
    return True


def both_sides(folder: Path) -> BothSides:
    """Take off, change the law in the air, land; the records are in folders of their own."""
    flight = asyncio.run(fly([*UP, _to_pid, wait(0.5), *DOWN], config=CONFIG, ground=RADIO))
    assert flight.ground is not None
    laws = {name: controller_text(name) for name in ("etnn", "pid")}
    ticks = map(tick_of, flight.ground.ground.ticks)
    ours, theirs = folder / "vehicle", folder / "ground"
    return BothSides(
        flight, recorded(flight.ticks, ours, CONFIG), recorded(ticks, theirs, CONFIG, side="ground", laws=laws)
    )
