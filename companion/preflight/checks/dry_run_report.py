"""Checks of a dry run: sensible commands of the law, and no fault that would have ended a flight."""

from collections.abc import Mapping
from dataclasses import dataclass

from companion.preflight.checks.check import Check
from companion.supervisor.faults import FailsafeAction, Fault, Stage, reaction_to


@dataclass(frozen=True)
class DryRunFacts:
    """Some seconds of a law that was listened to and not obeyed."""

    cycles: int
    """In which a setpoint was worked out."""
    not_finite: int
    law_fault: str
    """Error raised by the law or the guard; empty when there was none."""
    most_tilt_rad: float
    """Largest tilt of the setpoints that would have been sent."""
    thrust: tuple[float, float]
    """Least and largest."""
    events: Mapping[Fault, str]
    """Faults that the health checks found, each with its first message."""


def check_law(seen: DryRunFacts) -> Check:
    """Check that the law gave a finite command in every cycle."""
    todo = "look at the controller file, and at where the vehicle stands compared with the trajectory's start"
    low, high = seen.thrust
    says = seen.law_fault or (
        f"{seen.cycles} setpoints, tilt up to {seen.most_tilt_rad:.2f} rad, thrust {low:.2f} to {high:.2f}"
        + (f", {seen.not_finite} were no numbers" if seen.not_finite else "")
        if seen.cycles
        else "no setpoint at all: the vehicle's motion was never known"
    )
    return Check("law", seen.cycles > 0 and not seen.not_finite and not seen.law_fault, says, todo)


def check_health(seen: DryRunFacts) -> Check:
    """Check that the health checks of a flight found no fault."""
    says = "; ".join(f"{fault}: {text}" for fault, text in seen.events.items()) or "nothing"
    ended = [fault for fault in seen.events if reaction_to(fault, Stage.FLYING) > FailsafeAction.WARN]
    todo = "a flight would have been ended by it: docs/safety.md" if ended else "a flight would have gone on"
    return Check("faults", not seen.events, says, todo, must=bool(ended))
