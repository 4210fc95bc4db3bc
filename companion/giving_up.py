"""How the flight loop ends with a vehicle in the air: the autopilot lands, and gets what still helps it."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from companion.autopilot_calls import AutopilotCalls
from companion.ports import Clock

LOG = logging.getLogger(__name__)

_SEEN_DOWN_S = 30.0
"""A landing from the ceiling of any room takes less."""


@dataclass(frozen=True)
class Patience:
    """How long what is waited for."""

    period_s: float
    """Between two looks."""
    stow_s: float
    """For the arms to fold, or at least to come to rest."""
    land_refused_s: float
    """For an autopilot in OFFBOARD, which nobody flies, to begin its landing."""


class Given(Protocol):
    """The flight loop, as far as giving up goes."""

    @property
    def ticking(self) -> bool:
        """It goes on by itself."""

    @property
    def arms_busy(self) -> bool:
        """The arms move, or should."""

    @property
    def unflown(self) -> bool:
        """Given up, and the autopilot still shows OFFBOARD: it holds what it was told last."""

    @property
    def seen_landing(self) -> bool:
        """Armed, and seen by motion capture."""

    def hand_over(self, reason: str) -> None:
        """The autopilot lands what we still fly; nothing where we do not."""


class GivingUp:
    """Hands the vehicle over and waits for what follows.

    `parts` is what is left of a cycle when the loop itself has failed, each called with the time (s) once a period; one
    that raises is not called again, and the others go on.
    """

    def __init__(
        self,
        loop: Given,
        calls: AutopilotCalls,
        clock: Clock,
        patience: Patience,
        parts: Sequence[Callable[[float], None]],
    ) -> None:
        self._loop, self._calls, self._clock, self._patience = loop, calls, clock, patience
        self._parts = list(parts)

    async def give_up(self, reason: str) -> None:
        """Until the autopilot has answered and the arms have folded; after a failure, until the vehicle is down.

        An answer may come late and give us the vehicle back, so that it is handed over again.
        """
        begun_s = self._clock.now_s()
        self._loop.hand_over(reason)
        while self._waits(self._clock.now_s() - begun_s):
            self._go_on()
            await asyncio.sleep(self._patience.period_s)
            self._loop.hand_over(reason)
        self._go_on()

    def _waits(self, waited_s: float) -> bool:
        loop, patience = self._loop, self._patience
        return (
            self._calls.pending
            or (loop.arms_busy and waited_s < patience.stow_s)
            or (loop.unflown and waited_s < patience.land_refused_s)
            or (loop.seen_landing and not loop.ticking and waited_s < _SEEN_DOWN_S)
        )

    def _go_on(self) -> None:
        if self._loop.ticking:
            return
        now_s = self._clock.now_s()
        for part in list(self._parts):
            try:
                part(now_s)
            except Exception:
                LOG.exception("giving up goes on without this")
                self._parts.remove(part)
