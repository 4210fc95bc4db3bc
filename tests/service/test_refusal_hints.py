"""Whoever is refused because of the phase is told what to say first."""

import numpy as np
import pytest

from companion.core.types import FlightMode
from companion.service.refusal_hints import remedy_for
from companion.supervisor.flight_state import (
    FlightInputs,
    FlightRules,
    FlightState,
    HoldRequest,
    Phase,
    Request,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.state_machine import refusal
from companion.trajectories.reference import Hold

FACTS = FlightInputs(
    time_s=0.0, position_w_m=np.zeros(3), velocity_w_mps=np.zeros(3), yaw_rad=0.0, armed=True, mode=FlightMode.OFFBOARD
)
SAYS_NOTHING = {(Phase.RESUME, TakeoffRequest), (Phase.RESUME, HoldRequest)}
"""For three seconds at most."""


@pytest.mark.parametrize(
    "wanted", [TakeoffRequest(1.0), TrackRequest(Hold(np.zeros(3)), 0.0), HoldRequest(), ResumeRequest()]
)
def test_what_does_not_fit_a_phase_has_advice_and_what_fits_has_none(wanted: Request) -> None:
    for phase in Phase:
        refused = refusal(FlightState(phase=phase), wanted, FACTS, FlightRules())
        advises = refused.endswith(f"phase {phase}") and (phase, type(wanted)) not in SAYS_NOTHING
        assert bool(remedy_for(wanted, phase)) == advises, (phase, refused)
