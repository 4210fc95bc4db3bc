"""Result of one preflight check, as in the reply to the command `preflight`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol


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


class Tell(Protocol):
    """Receiver of what a preflight waits for."""

    def __call__(self, text: str, checks: Sequence[Check] = ()) -> None:
        """Take a sentence, and the checks whose result is known by now."""


def checks_of(data: Mapping[str, Any]) -> tuple[Check, ...]:
    """Return the checks in the data of a reply, without fields that only an older or newer service knows."""
    known = {field.name for field in fields(Check)}
    return tuple(
        Check(**{name: value for name, value in one.items() if name in known}) for one in data.get("checks", ())
    )
