"""Stream of setpoints to the autopilot, and the watchdog timer, because MAVSDK repeats the last one for ever."""

import logging
import math

from companion.control.pipeline import idle_setpoint, same_setpoint
from companion.core.interfaces import Autopilot, Clock, CompanionError, WatchdogTimer
from companion.core.types import AttitudeThrust
from companion.supervisor.faults import Event, Fault

LOG = logging.getLogger(__name__)


class SetpointStream:
    """Owns whether setpoints leave, and which one left last. Nothing here raises because of the link."""

    def __init__(self, autopilot: Autopilot, watchdog_timer: WatchdogTimer, clock: Clock, unsent_s: float) -> None:
        self._autopilot, self._watchdog_timer, self._clock = autopilot, watchdog_timer, clock
        self._unsent_limit_s = unsent_s
        self._unsent_since_s, self._why_unsent = math.inf, ""
        self.on = False
        """The autopilot gets a setpoint of ours again and again."""
        self.law_sent = self.wire = idle_setpoint(0.0)
        """The law's setpoint that left last, or that the stream began with; and with the horizon corrected, `wire`."""

    @property
    def sent(self) -> AttitudeThrust | None:
        """The law's setpoint that the autopilot is told now, what the vehicle is to do; None while nothing leaves."""
        return self.law_sent if self.on else None

    @property
    def failing(self) -> bool:
        """True while setpoints cannot be sent."""
        return math.isfinite(self._unsent_since_s)

    def begin(self, at: AttitudeThrust) -> None:
        """A new stream, whose first setpoint is limited as if `at` had left before it; an earlier one ends."""
        if self.on:
            self.stop()
        self.law_sent = self.wire = at

    def send(self, setpoint: AttitudeThrust, wire: AttitudeThrust | None = None) -> float:
        """Send it unless the autopilot has it; when it had left (s), or NaN. One that cannot be sent is not `sent`.

        `wire` is what leaves in its place, with the autopilot's horizon corrected; None: itself.
        """
        wire = setpoint if wire is None else wire
        if self.on and same_setpoint(wire, self.wire):
            self.law_sent, self._unsent_since_s = setpoint, math.inf
            return math.nan
        try:
            self._autopilot.send_setpoint(wire)
        except Exception as error:
            self._fail(error)
            return math.nan
        self.law_sent, self.wire, self.on, self._unsent_since_s = setpoint, wire, True, math.inf
        return self._clock.now_s()

    def _fail(self, error: Exception) -> None:
        if self.failing:
            return
        self._unsent_since_s = self._clock.now_s()
        self._why_unsent = str(error) if isinstance(error, CompanionError) else f"{type(error).__name__}: {error}"
        LOG.error("a setpoint was not sent, the next one may be: %s", self._why_unsent)

    def fault(self, now_s: float) -> Event | None:
        """That setpoints cannot be sent any more; a single one that is lost follows from no fault."""
        unsent_s = now_s - self._unsent_since_s
        if unsent_s < self._unsent_limit_s:
            return None
        return Event(Fault.SETPOINT_NOT_FOLLOWED, f"no setpoint could be sent for {unsent_s:.2f} s: {self._why_unsent}")

    def renew(self) -> None:
        """Renew the watchdog timer; called once a cycle while setpoints may leave."""
        if self.on:
            self._watchdog_timer.renew()

    def stop(self) -> None:
        """End the stream and release the watchdog timer, which otherwise ends this process."""
        if self.on:
            try:
                self._autopilot.stop_stream()
            except Exception:
                LOG.exception("the stream of setpoints could not be stopped")
                return
            self.on = False
        self._unsent_since_s = math.inf
        self._watchdog_timer.release()
