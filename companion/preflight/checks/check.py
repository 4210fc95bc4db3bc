"""Result of one check, and the arming decision from many."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """Result of one check, a line of the list."""

    name: str
    passed: bool
    says: str
    """Result, with numbers and units."""
    todo: str = ""
    """Remedy where it did not pass; begins with a small letter, ends without a full stop."""
    must: bool = True
    """Arming is refused while it fails; False: a warning."""

    @property
    def refuses(self) -> bool:
        """True when this check prevents arming."""
        return self.must and not self.passed


def refusal(checks: Iterable[Check]) -> str:
    """Return why the vehicle may not arm, each reason with its remedy; empty when it may."""
    failed = [check for check in checks if check.refuses]
    if not failed:
        return ""
    count = "a preflight check fails" if len(failed) == 1 else f"{len(failed)} preflight checks fail"
    return "\n".join([count, *(f"  {check.name}: {check.says}; {check.todo}" for check in failed)])
