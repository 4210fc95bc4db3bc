"""Faults that are not recognised on a vehicle that motion capture's frames do not reach, and the words for it. Pure."""

from companion.supervisor.faults import TABLE, Fault, PoseNeed

_WHY = "because frames do not reach the vehicle"

OFF_BY_NEED: dict[PoseNeed, tuple[Fault, ...]] = {
    need: tuple(row.fault for row in TABLE if row.needs is need) for need in PoseNeed
}
"""Faults that are off, by what they need, in the table's order."""
OFF = frozenset(fault for faults in OFF_BY_NEED.values() for fault in faults)
"""All faults that are off."""


def off_words(need: PoseNeed) -> str:
    """Return the sentence that says which faults are off for want of one part of the pose, and why."""
    return f"off: {', '.join(OFF_BY_NEED[need])}, {_WHY}"


def off_sentence() -> str:
    """Return the sentence that says in few words what is off in all, and why."""
    checks = ", ".join(PoseNeed)
    return f"off: the checks of {checks}, the guard's fence and the horizon correction, {_WHY}"
