"""Law that runs elsewhere: its newest command, held until the next one (zero-order hold, as u(t) in the paper)."""

from math import inf

import numpy as np

from companion.control.controller import ControlInput, ControlOutput
from companion.core.types import Array
from companion.core.values import value

NO_COMMAND = np.zeros(3)


@value(kw_only=True)
class RemoteCommand:
    """Command of a law on the ground that is in use in this cycle."""

    number: int
    """Number of the command; 0 while this flight has none yet, and the vehicle hovers level."""
    accel_w_mps2: Array
    yaw_rad: float | None
    """Heading; None: that of the reference."""
    age_s: float
    """Time since the ground law last showed that the command still holds."""


NOTHING_HEARD = RemoteCommand(number=0, accel_w_mps2=NO_COMMAND, yaw_rad=None, age_s=inf)


class RemoteLaw:
    """Controller whose output is the command in use; `command` is set before each cycle."""

    preview_s = 0.0

    def __init__(self) -> None:
        self.command = NOTHING_HEARD

    def initial(self, first: ControlInput) -> int:  # noqa: ARG002 - the interface of a law
        """Return the number of the last command: none."""
        return 0

    def step(self, memory: int, now: ControlInput) -> tuple[int, ControlOutput]:  # noqa: ARG002
        """Return the command in use; a new one is an event."""
        c = self.command
        output = ControlOutput(
            accel_w_mps2=c.accel_w_mps2,
            event=np.array([float(c.number != memory)]),
            signals={},
            yaw_rad=c.yaw_rad,
            age_s=c.age_s,
        )
        return c.number, output
