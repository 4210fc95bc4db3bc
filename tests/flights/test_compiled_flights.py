"""A whole flight with compiled code and one in Python alone: every cycle the same, to the last bit."""

from typing import Any

import numpy as np
import pytest

from companion.compiled.leaves import leaves
from companion.compiled.library import library
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.flight.tick import Tick
from companion.supervisor.flight_state import LandRequest, Phase, TrackRequest
from tests.flights.faults import acts
from tests.flights.simulated import Flight, Step, fly
from tests.flights.test_simulated_flights import LAP, QUICK_UP, ask, inject, until, wait

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled"),
]
USERS = (
    "companion.estimation.frame_estimator",
    "companion.control.compiled.pipeline",
    "companion.control.compiled.wire",
)


def switch(name: str) -> Step:
    def step(flight: Flight) -> bool:
        flight.loop.switch(load_controller(name, CompanionConfig().vehicle_model(), 0.01).law, name)
        return True

    return step


def blow(flight: Flight) -> bool:
    acts.gust((9.0, -4.0, 0.0), 0.5)(flight)
    return True


EVENTFUL = [
    *QUICK_UP,
    inject("mocap off for 0.08 s"),
    wait(0.3),
    ask(TrackRequest(LAP, 0.1)),
    until(Phase.TRACK),
    switch("pid"),
    wait(0.3),
    switch("etnn"),
    blow,
    wait(1.0),
    inject("mocap wrong (lost) for 0.05 s"),
    wait(0.2),
    ask(LandRequest()),
    until(Phase.DISARMED),
]
"""Frames lost and without the body, another law and back, a gust that takes setpoints to their limits."""


def numbers(tick: Tick) -> dict[str, Any]:
    """Return what a cycle knew and gave."""
    parts: dict[str, Any] = {"estimate": tick.estimate, "wire": tick.wire and (tick.wire.setpoint, tick.wire.horizon)}
    if tick.pipeline is not None:
        output = tick.pipeline.law_output
        limited = {name: value for name, value in vars(tick.pipeline.limited).items() if name != "failure"}
        signals = tuple((output.signals | tick.late_signals).items())
        parts |= {"law": (output.accel_w_mps2, output.event, signals), "given": tick.pipeline.given}
        parts |= limited
    found = {f"{name}.{path}": value for name, part in parts.items() for path, value in leaves(part)}
    return found | {"phase": tick.flight.phase, "verdict": tick.estimate and tick.estimate.verdict}


def equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray | float):
        return np.array_equal(one, other, equal_nan=True)
    return bool(one == other)


async def test_every_cycle_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    fast = await fly(EVENTFUL)
    for user in USERS:
        monkeypatch.setattr(f"{user}.quick_library", lambda: None)
    wanted = await fly(EVENTFUL)
    assert len(fast.ticks) == len(wanted.ticks)
    for one, other in zip(fast.ticks, wanted.ticks, strict=True):
        a, b = numbers(one), numbers(other)
        assert a.keys() == b.keys()
        assert [name for name in a if not equal(a[name], b[name])] == []
    cut = [tick.limited for tick in fast.ticks if tick.limited is not None]
    assert any(limited.slew_cut or limited.tilt_cut or limited.fence_cut for limited in cut)
