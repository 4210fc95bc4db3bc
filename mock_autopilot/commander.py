"""PX4's commander: arming, modes, failsafes. Recorded behaviour: docs/px4-conformance.md, sections a, b, c, e, g, h.

It decides from a `Situation` and never looks at the vehicle itself, so every case can be tried on its own.
"""

from dataclasses import dataclass

from mock_autopilot.params import ParamTable
from mock_autopilot.px4 import (
    CUSTOM_MODE_ENABLED,
    FORCE_MAGIC,
    GUIDED_OR_AUTO,
    MANUAL_INPUT,
    SAFETY_ARMED,
    STABILIZE,
    Mode,
    Result,
    Severity,
    SystemStatus,
    Text,
)

PREFLIGHT_DISARM_EXTRA_S = 1.0
"""Recorded: 11.0 s of the simulator's time with COM_DISARM_PRFLT = 10."""
NEEDS_PILOT = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.ACRO, Mode.STABILIZED})
"""Modes that need a remote control; the only pilot there may be (a fault) knows but Position."""
NO_ARMING = frozenset({Mode.LAND, Mode.RTL, Mode.DESCEND})
"""Modes in which it cannot be armed. Once it is armed the checks go on passing in them, as recorded."""
AUTO_SUB_MODES = {2: Mode.TAKEOFF, 3: Mode.HOLD, 4: Mode.MISSION, 5: Mode.RTL, 6: Mode.LAND}
MAIN_MODES = {
    1: Mode.MANUAL,
    2: Mode.ALTITUDE,
    3: Mode.POSITION,
    5: Mode.ACRO,
    6: Mode.OFFBOARD,
    7: Mode.STABILIZED,
}
LOSS_REACTION = {
    3: (Mode.RTL, Mode.LAND),
    4: (Mode.LAND,),
    5: (Mode.HOLD, Mode.RTL, Mode.LAND),
}
"""COM_OBL_RC_ACT: what to try in turn; anything else asks for a pilot's mode and ends up as 3 does."""
TERMINATE, DISARM = 6, 7


@dataclass(frozen=True)
class Situation:
    """What the commander is told."""

    now_s: float
    landed: bool
    local_ok: bool
    global_ok: bool
    offboard_ok: bool
    """Setpoints came within COM_OF_LOSS_T."""
    offboard_attitude: bool
    """The last setpoint asked for attitude control."""
    remote: bool = False
    """A pilot with a remote control is there."""


class Commander:
    """The state machine; `texts` collects what it has to say."""

    def __init__(self, params: ParamTable, checks_pass_s: float) -> None:
        self._params = params
        self._checks_pass_s = checks_pass_s
        self.user_mode = Mode.HOLD
        self.mode = Mode.HOLD
        self.armed = False
        self.failsafe = False
        self.texts: list[Text] = []
        self.armed_at_s = 0.0
        self.flown = False
        self._landed_at_s: float | None = None
        self._was_landed = True

    # -- what it shows ---------------------------------------------------------------------------

    def can_arm(self, now: Situation) -> bool:
        """The arming checks of the chosen mode, in flight of the mode it flies, pass (the prearm bit of SYS_STATUS)."""
        if self.armed:
            return self.checked(now) and _can_run(self.mode, now)
        return self.checked(now) and self.user_mode not in NO_ARMING and _can_run(self.user_mode, now)

    def checked(self, now: Situation) -> bool:
        """Return whether the first checks after the boot are over."""
        return now.now_s >= self._checks_pass_s

    def system_status(self, now: Situation) -> SystemStatus:
        """HEARTBEAT.system_status."""
        if self.armed:
            return SystemStatus.FAILSAFE if self.failsafe else SystemStatus.ACTIVE
        return SystemStatus.STANDBY if self.can_arm(now) else SystemStatus.NOT_READY

    def base_mode(self, now: Situation) -> int:
        """HEARTBEAT.base_mode; OFFBOARD has neither the auto nor the guided bit."""
        bits = CUSTOM_MODE_ENABLED | (SAFETY_ARMED if self.armed else 0)
        if self.mode is Mode.OFFBOARD:
            return bits | (STABILIZE if now.offboard_attitude else 0)
        bits |= GUIDED_OR_AUTO if self.mode.is_auto else MANUAL_INPUT
        return bits | (0 if self.mode is Mode.ACRO else STABILIZE)

    def _say(self, severity: Severity, text: str) -> None:
        self.texts.append(Text(severity, text + "\t"))

    # -- commands --------------------------------------------------------------------------------

    def arm_disarm(self, arm: float, force: float, now: Situation) -> Result | None:
        """COMPONENT_ARM_DISARM; None where PX4 leaves the sender without an ACK."""
        forced = force == FORCE_MAGIC
        if arm == 1.0:
            return self._arm(forced, now)
        if arm == 0.0:
            return self._disarm_by_command(forced, now)
        self._say(Severity.CRITICAL, f"Unsupported ARM_DISARM param: {arm:.3f}")
        return None

    def _arm(self, forced: bool, now: Situation) -> Result:
        if self.armed:
            return Result.ACCEPTED
        if not forced and not self.can_arm(now):
            self._say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        self.armed, self.armed_at_s, self.flown, self._landed_at_s = True, now.now_s, False, None
        self._say(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def _disarm_by_command(self, forced: bool, now: Situation) -> Result:
        if not self.armed:
            return Result.ACCEPTED
        if not forced and not now.landed:
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.disarm("Disarmed by external command")
        return Result.ACCEPTED

    def disarm(self, text: str) -> None:
        """Stop the motors, wherever it is; `text` says why."""
        self.armed = self.failsafe = False
        if self.user_mode in {Mode.LAND, Mode.RTL}:
            self.user_mode = Mode.HOLD
        self.mode = self.user_mode
        self._say(Severity.INFO, text)

    def set_mode(self, base_mode: int, main: int, sub: int, now: Situation) -> Result:
        """DO_SET_MODE as the commander answers it (the link has said ACCEPTED before)."""
        if not base_mode & CUSTOM_MODE_ENABLED:
            return Result.ACCEPTED
        if main == 4:
            mode = AUTO_SUB_MODES.get(sub)
            if mode is None:
                self.texts.append(Text(Severity.CRITICAL, "Unsupported auto mode\t"))
                return Result.TEMPORARILY_REJECTED
            return self.choose(mode, now)
        known = MAIN_MODES.get(main)
        return Result.ACCEPTED if known is None else self.choose(known, now)

    def choose(self, mode: Mode, now: Situation) -> Result:
        """Take a mode the user asks for; while armed only one that can be flown."""
        if self.armed and not _can_run(mode, now):
            self._say(Severity.CRITICAL, f"Switching to {mode.title} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.user_mode = self.mode = mode
        self.failsafe = False
        return Result.ACCEPTED

    # -- every tick ------------------------------------------------------------------------------

    def step(self, now: Situation) -> None:
        """Notice take-off and landing, react to what was lost, disarm when all is over."""
        self._watch_ground(now)
        if not self.armed:
            return
        self._watch_failsafe(now)
        if self.armed:
            self._disarm_when_done(now)

    def _watch_ground(self, now: Situation) -> None:
        if self._was_landed and not now.landed and self.armed:
            self.flown, self._landed_at_s = True, None
            self._say(Severity.INFO, "Takeoff detected")
        if not self._was_landed and now.landed and self.armed:
            self._landed_at_s = now.now_s
            self._say(Severity.INFO, "Landing detected")
        self._was_landed = now.landed

    def _watch_failsafe(self, now: Situation) -> None:
        if _can_run(self.user_mode, now):
            if self.failsafe:  # what was missing is back: so is the mode, without any command
                self.mode, self.failsafe = self.user_mode, False
            return
        action = int(self._params["COM_OBL_RC_ACT"])
        if self.user_mode is Mode.OFFBOARD and action in {TERMINATE, DISARM}:
            self._say(Severity.CRITICAL, "Failsafe activated")
            self.disarm("Disarmed by failsafe")
            return
        offboard = self.user_mode is Mode.OFFBOARD
        wanted = LOSS_REACTION.get(action, LOSS_REACTION[3]) if offboard else (Mode.LAND,)
        if self.failsafe and (self.mode is Mode.LAND or _can_run(self.mode, now)):
            return  # once landing, PX4 was seen to stay with it, position or not
        self.mode = next((mode for mode in wanted if _can_run(mode, now)), Mode.DESCEND)
        if not self.failsafe:
            self._say(Severity.CRITICAL, "Failsafe activated")
        self.failsafe = True

    def _disarm_when_done(self, now: Situation) -> None:
        after_landing_s = self._params["COM_DISARM_LAND"]
        preflight_s = self._params["COM_DISARM_PRFLT"]
        if self._landed_at_s is not None:
            if after_landing_s > 0.0 and now.now_s - self._landed_at_s >= after_landing_s:
                self.disarm("Disarmed by landing")
        elif not self.flown and 0.0 < preflight_s <= now.now_s - self.armed_at_s - PREFLIGHT_DISARM_EXTRA_S + 1e-9:
            self.disarm("Disarmed by auto preflight disarming")


def _can_run(mode: Mode, now: Situation) -> bool:
    """Whether a mode has what it needs, by PX4's mode requirements."""
    if mode is Mode.OFFBOARD:
        return now.offboard_ok
    if mode is Mode.POSITION:
        return now.remote and now.local_ok
    if mode in NEEDS_PILOT or mode is Mode.MISSION:
        return False
    if mode in {Mode.HOLD, Mode.RTL}:
        return now.local_ok and now.global_ok
    return mode is Mode.DESCEND or now.local_ok
