"""The arming decision from the results of many checks."""

from collections.abc import Iterable

from companion.protocol.check import Check

__all__ = ["Check", "refusal"]


def refusal(checks: Iterable[Check]) -> str:
    """Return why the vehicle may not arm, each reason with its remedy; empty when it may."""
    failed = [check for check in checks if check.refuses]
    if not failed:
        return ""
    count = "a preflight check fails" if len(failed) == 1 else f"{len(failed)} preflight checks fail"
    return "\n".join([count, *(f"  {check.name}: {check.says}; {check.todo}" for check in failed)])
