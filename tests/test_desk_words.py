"""Whoever is refused because of the phase is told what to say first."""

import numpy as np
import pytest

from companion.control.reference import Hold
from companion.desk_words import first
from companion.supervisor.flight import Brake, Facts, Flight, FlightRules, Fly, Phase, Request, Resume, TakeOff
from companion.supervisor.phases import refusal
from companion.types import FlightMode

FACTS = Facts(0.0, np.zeros(3), np.zeros(3), 0.0, armed=True, mode=FlightMode.OFFBOARD)
SAYS_NOTHING = {(Phase.RESUME, TakeOff), (Phase.RESUME, Brake)}
"""For three seconds at most."""


@pytest.mark.parametrize("wanted", [TakeOff(1.0), Fly(Hold(np.zeros(3)), 0.0), Brake(), Resume()])
def test_what_does_not_fit_a_phase_has_advice_and_what_fits_has_none(wanted: Request) -> None:
    for phase in Phase:
        refused = refusal(Flight(phase=phase), wanted, FACTS, FlightRules())
        advises = refused.endswith(f"phase {phase}") and (phase, type(wanted)) not in SAYS_NOTHING
        assert bool(first(wanted, phase)) == advises, (phase, refused)
