"""Faults that are not recognised on a vehicle that motion capture's frames do not reach, and the words for it. Pure."""

from collections.abc import Iterable

from companion.supervisor.faults import TABLE, Fault, PoseNeed

_WHY = "because frames do not reach the vehicle"

OFF_BY_NEED: dict[PoseNeed, tuple[Fault, ...]] = {
    need: tuple(row.fault for row in TABLE if row.needs is need) for need in PoseNeed
}
"""Faults that are off, by what they need, in the table's order."""
OFF = frozenset(fault for faults in OFF_BY_NEED.values() for fault in faults)
"""All faults that are off."""
OFF_BESIDE_FAULTS = ("the guard's fence", "the horizon correction")
"""What else needs frames on the vehicle."""


def off_words(names: Iterable[str]) -> str:
    """Return the sentence that says that these are off, and why."""
    return f"off: {', '.join(names)}, {_WHY}"


def off_sentence() -> str:
    """Return the sentence that says in few words what is off in all, and why."""
    return off_words((f"the checks of {', '.join(PoseNeed)}", *OFF_BESIDE_FAULTS))
