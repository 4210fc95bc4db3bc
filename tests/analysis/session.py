"""A session in simulated time: goto, an ellipse, another law, goto, a figure 8; seconds of hold between them."""

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.analysis.report.recorded_flight import Flown
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_path, load_controller
from companion.records.read import read_flight
from companion.supervisor.flight_state import Phase, TrackRequest
from companion.trajectories.reference import Ellipse, FigureEight, Hold, LapTiming, Trajectory
from tests.analysis.recorded import recorded
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import DOWN, UP, ask, until, wait

CONFIG = CompanionConfig()
CENTRE = np.array([0.0, 0.0, 1.2])
ELLIPSE = Ellipse(CENTRE, (0.5, 0.3), LapTiming(5.0, 1, ramp_s=2.0))
FIGURE8 = FigureEight(CENTRE, (0.5, 0.3), LapTiming(5.0, 1, ramp_s=2.0))
ASIDE = Hold(np.array([0.4, -0.3, 1.0]), 0.0)


@dataclass(frozen=True)
class Session:
    flight: Flight
    path: Path
    flown: Flown


def session(folder: Path) -> Session:
    """Fly it, and write its record as the service does."""
    told: list[tuple[float, str, str]] = []

    def say(text: str, then: Step) -> Step:
        def step(flight: Flight) -> bool:
            told.append((flight.room.now_s(), "command", text))
            return then(flight)

        return step

    def go(text: str, trajectory: Trajectory, settle_s: float) -> list[Step]:
        return [say(text, ask(TrackRequest(trajectory, settle_s))), until(Phase.TRACK), until(Phase.HOLD)]

    def to_pid(flight: Flight) -> bool:
        flight.loop.switch(load_controller("pid", CONFIG.vehicle_model(), 0.01).law, "pid")
        return True

    script = [
        *UP, *go("goto x_m=0.4 y_m=-0.3 z_m=1.0", ASIDE, 0.0), wait(1.0),
        *go("track curve=ellipse laps=1", ELLIPSE, 0.5), wait(1.5),
        say("controller name=pid", to_pid), wait(1.5),
        *go("track curve=figure8 laps=1", FIGURE8, 0.5), wait(1.0), *DOWN,
    ]  # fmt: skip
    flight = asyncio.run(fly(script))
    ticks = [replace(tick, law=tick.law or "etnn") for tick in flight.ticks]
    laws = {name: controller_path(name).read_text(encoding="utf-8") for name in ("etnn", "pid")}
    path = recorded(ticks, folder, told=told, laws=laws)
    return Session(flight, path, Flown(read_flight(path)))
