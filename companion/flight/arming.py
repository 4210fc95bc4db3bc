"""Arming, from the operator's request until the flight's first phase: all is checked, and it can be called off."""

from collections.abc import Iterator
from contextlib import contextmanager

from companion.core.interfaces import FlightError
from companion.core.types import AutopilotStatus
from companion.supervisor.flight_state import ArmRequest, Request, ResumeRequest

_UNKNOWN = "the autopilot does not say whether the vehicle stands or flies"


def refused_for(wanted: Request, status: AutopilotStatus) -> str:
    """Return why the autopilot's status rules out a request; empty when it does not."""
    if isinstance(wanted, ArmRequest) and (status.armed or status.in_air is not False):
        # it would stream zero thrust, and PX4 takes OFFBOARD up by itself when a stream begins
        known = status.armed or status.in_air is not None
        return "the vehicle is already armed or in the air" if known else _UNKNOWN
    if isinstance(wanted, ResumeRequest) and not status.in_air:
        return _UNKNOWN if status.in_air is None else "the autopilot says that the vehicle is on the ground"
    return ""


class Arming:
    """Between whoever checks, and whoever orders that nothing may follow from it."""

    def __init__(self) -> None:
        self.under_way = False
        """The checks run; the flight is in a phase on the ground in which nothing is sent."""
        self.called_off = ""
        """Why nothing follows from the checks; empty when they were not called off."""

    @contextmanager
    def checking(self) -> Iterator[None]:
        """While the checks run; FlightError when others run already."""
        if self.under_way:
            raise FlightError("the checks before arming run already; wait until they end")
        self.under_way, self.called_off = True, ""
        try:
            yield
        finally:
            self.under_way = False

    def call_off(self, why: str) -> bool:
        """End the checks; return whether any ran."""
        if self.under_way:
            self.called_off = self.called_off or why
        return self.under_way
