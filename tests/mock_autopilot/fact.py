"""One recorded fact about PX4, and how the mock's answer to it is measured."""

from collections.abc import Callable
from dataclasses import dataclass

Value = float | str


@dataclass(frozen=True)
class Fact:
    """PX4's value and the accepted values of the mock: a range for numbers, the same text for texts."""

    id: str
    what: str
    px4: str
    measure: Callable[[], Value]
    accepted: tuple[float, float] | None = None
    unit: str = ""
    source: str = ""
    """The recording; empty: its section's."""

    @property
    def section(self) -> str:
        return self.id.split("-")[0]

    def holds(self, value: Value) -> bool:
        if self.accepted is None or isinstance(value, str):
            return value == self.px4
        return self.accepted[0] <= value <= self.accepted[1]

    def show(self, value: Value) -> str:
        """Return the value as the table shows it."""
        return value if isinstance(value, str) else f"{value:.2f} {self.unit}".strip()

    @property
    def tolerance(self) -> str:
        return (
            "the same" if self.accepted is None else f"{self.accepted[0]:g} to {self.accepted[1]:g} {self.unit}".strip()
        )


def same(id_: str, what: str, px4: str, measure: Callable[[], str], source: str = "") -> Fact:
    """Return a fact whose text must be exactly PX4's."""
    return Fact(id_, what, px4, measure, source=source)


def near(
    id_: str,
    what: str,
    px4: str,
    measure: Callable[[], float],
    accepted: tuple[float, float],
    unit: str = "s",
    source: str = "",
) -> Fact:
    """Return a fact whose number must be in the accepted range."""
    return Fact(id_, what, px4, measure, accepted, unit, source)


NAMES = {0: "ACCEPTED", 1: "TEMPORARILY_REJECTED", 2: "DENIED", 3: "UNSUPPORTED", 4: "FAILED"}


def acks(results: list[int]) -> str:
    """Return the names of COMMAND_ACKs' results."""
    return ", ".join(NAMES[int(result)] for result in results) or "no ACK"


def state(heartbeat: tuple[int, int, int]) -> str:
    """Return base_mode, main and sub mode and system_status of a HEARTBEAT as text."""
    base, custom, status = heartbeat
    return f"{base}, {custom >> 16 & 0xFF}/{custom >> 24 & 0xFF}, {status}"
