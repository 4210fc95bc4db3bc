"""End of the flight loop with a vehicle in the air: the autopilot lands, and gets what still helps it."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from companion.core.types import FlightMode
from companion.estimation.estimator import EstimatorState, age_s
from companion.flight.arm_step import ArmStep
from companion.flight.assembly import Devices
from companion.flight.autopilot_calls import AutopilotCalls
from companion.supervisor.flight_state import FlightState, Phase

LOG = logging.getLogger(__name__)

_SEEN_DOWN_S = 30.0
"""A landing from the ceiling of any room takes less."""


class Given(Protocol):
    """The flight loop, as far as giving up goes."""

    @property
    def ticking(self) -> bool:
        """It goes on by itself."""

    @property
    def flight(self) -> FlightState:
        """The present phase and all that goes with it."""

    @property
    def estimate(self) -> EstimatorState:
        """Return the latest estimate of the vehicle's motion."""

    @property
    def arms(self) -> ArmStep | None:
        """None for a vehicle without."""

    def hand_over(self, reason: str) -> None:
        """The autopilot lands what we still fly; nothing where we do not."""


@dataclass(frozen=True)
class ShutdownTimes:
    """Periods and bounds of what a shutdown waits for, s."""

    period_s: float
    stow_s: float
    """Longest time the arms take to fold."""
    land_refused_s: float
    """Time within which the autopilot must leave OFFBOARD after it was told to land."""
    silent_s: float
    """Age of the estimate above which motion capture does not see the vehicle."""


class Shutdown:
    """Hands the vehicle over and waits for what follows.

    `parts` is what is left of a cycle when the loop itself has failed, each called with the time (s) once a period; one
    that raises is not called again, and the others go on.
    """

    def __init__(
        self,
        loop: Given,
        calls: AutopilotCalls,
        devices: Devices,
        times: ShutdownTimes,
        parts: Sequence[Callable[[float], None]],
    ) -> None:
        self._loop, self._calls, self._clock, self._autopilot = loop, calls, devices.clock, devices.autopilot
        self._times, self._parts = times, [*parts, self._fold_arms]

    async def give_up(self, reason: str) -> None:
        """Until the autopilot has answered and the arms have folded; after a failure, until the vehicle is down.

        An answer may come late and give us the vehicle back, so that it is handed over again.
        """
        begun_s = self._clock.now_s()
        self._loop.hand_over(reason)
        while self._waits(self._clock.now_s() - begun_s):
            self._go_on()
            await asyncio.sleep(self._times.period_s)
            self._loop.hand_over(reason)
        self._go_on()

    def _waits(self, waited_s: float) -> bool:
        """For an answer, for the arms to fold, for PX4 to begin its landing, and to end it if nobody else looks."""
        return (
            self._calls.pending
            or (self._arms_busy() and waited_s < self._times.stow_s)
            or (self._unflown() and waited_s < self._times.land_refused_s)
            or (self._seen_landing() and not self._loop.ticking and waited_s < _SEEN_DOWN_S)
        )

    def _arms_busy(self) -> bool:
        """The arms move, or should."""
        return self._loop.arms is not None and self._loop.arms.is_busy(self._loop.flight)

    def _unflown(self) -> bool:
        """Given up, and the autopilot still shows OFFBOARD: it holds what it was told last."""
        status = self._autopilot.status()
        return self._loop.flight.phase is Phase.HANDED_OVER and status.armed and status.mode is FlightMode.OFFBOARD

    def _seen_landing(self) -> bool:
        """Armed, and seen by motion capture."""
        seen = age_s(self._loop.estimate, self._clock.now_s()) < self._times.silent_s
        return seen and self._autopilot.status().armed

    def _fold_arms(self, now_s: float) -> None:
        if self._loop.arms is not None:
            self._loop.arms.read(now_s, self._loop.flight)
            self._loop.arms.tick(now_s, self._loop.flight)

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
