"""A recommended value of one of the autopilot's parameters. Pure."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Recommended:
    """Recommended value of one parameter; of the four conditions those count that are given."""

    name: str
    set_to: float
    """What to set it to; meets the conditions."""
    why: str
    must: bool = True
    one_of: tuple[float, ...] = ()
    bits: int = 0
    """So many bits must be set, others may be."""
    at_least: float = -math.inf
    at_most: float = math.inf
    reboot: bool = False
    """It counts only after a restart of PX4."""
    optional: bool = False
    """A PX4 that does not have it (another release, or built without that sensor) is right as it is."""

    def accepts(self, value: float) -> bool:
        """Return True if the value meets every condition."""
        listed = not self.one_of or any(math.isclose(value, one, abs_tol=1e-6) for one in self.one_of)
        return listed and int(value) & self.bits == self.bits and self._within(value)

    def _within(self, value: float) -> bool:
        """PX4's are 32 bit floats: 0.5 may come back as a little more."""
        slack = 1e-6 * max(1.0, abs(value))
        return self.at_least - slack <= value <= self.at_most + slack

    @property
    def wanted(self) -> str:
        """The conditions in words."""
        words = []
        if self.one_of:
            words.append(" or ".join(f"{one:g}" for one in self.one_of))
        if self.bits:
            words.append("bits " + ", ".join(str(bit) for bit in range(32) if self.bits >> bit & 1) + " set")
        if self.at_least > -math.inf:
            words.append(f"at least {self.at_least:g}")
        if self.at_most < math.inf:
            words.append(f"at most {self.at_most:g}")
        return " and ".join(words)
