"""PX4's commander: arming, modes, failsafes. Recorded behaviour: docs/px4-conformance.md, sections a, b, c, e, g, h.

It decides from `FailsafeFlags` and never reads the vehicle itself, so every case can be tested on its own.
"""

from dataclasses import replace

from mock_autopilot.px4 import failsafe
from mock_autopilot.px4.failsafe import Action, Failsafe, FailsafeFlags, can_run
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.vocabulary import (
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
"""Modes that need a pilot's sticks."""
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
CHECK_PERIOD_S = 0.05
"""Period of the checks of what the modes need, which also run when the state changes. PX4 does it at 10 Hz, and noticed
the loss of setpoints 0.09 to 0.105 s late, that of sticks and poses 0.01 to 0.04 s late."""
OFFBOARD_LATE_S = 0.05
"""Setpoints count as missing this long after COM_OF_LOSS_T."""
LOG_NAME = "[logger] ./log/2026-11-29/{:02d}_{:02d}_{:02d}.ulg"
"""Said when a log begins; PX4's clock is the simulator's, which booted at 21:00:00."""
LOG_FROM_BOOT = 1
"""SDLOG_MODE: until it is disarmed; then, and with any other value, from arming to disarming."""
BATTERY_TEXTS = {
    failsafe.LOW: (Severity.CRITICAL, "Low battery"),
    failsafe.CRITICAL: (Severity.CRITICAL, "Critical battery"),
    failsafe.EMERGENCY: (Severity.EMERGENCY, "Emergency battery level"),
}
PREFLIGHT_TEXT = "Preflight Fail: {}"
OVERRIDE_AUTO, OVERRIDE_OFFBOARD = 1, 2
"""Bits of COM_RC_OVERRIDE: where the sticks take over."""


class Commander:
    """The commander's state machine; `texts` collects its messages to the ground station."""

    def __init__(self, params: ParamTable, checks_pass_s: float) -> None:
        self._params = params
        self._checks_pass_s = checks_pass_s
        self.user_mode = Mode.HOLD
        self.mode = Mode.HOLD
        self.intended_mode = Mode.HOLD
        """The user's mode, as published."""
        self._after_disarm = Mode.HOLD
        self._ever_chose = self._just_chose = False
        self.armed = False
        self.wrecked = False
        """It has collided, and will not arm again."""
        self.texts: list[Text] = []
        self.events_told = 0
        self.armed_at_s = 0.0
        self.flown = False
        self.commands_handled = 0
        """Number of commands handled; PX4 publishes its state after every one."""
        self._failsafe = Failsafe(params)
        self._landed_at_s: float | None = None
        self._was_landed = True
        self._checked: FailsafeFlags | None = None
        """The flags at the last checks."""
        self._check_due_s = 0.0
        self._reported: tuple[object, ...] = ()
        self._logs = False
        if int(params["SDLOG_MODE"]) == LOG_FROM_BOOT:
            self._say_log(0.0)

    @property
    def failsafe(self) -> bool:
        """Return whether a failsafe flies the vehicle."""
        return self._failsafe.action > Action.WARN

    # -- what it shows ---------------------------------------------------------------------------

    def can_arm(self, now: FailsafeFlags) -> bool:
        """Return whether the checks of the chosen mode (armed: of the flown one) pass: SYS_STATUS's prearm bit."""
        if self.armed:
            return self.checked(now) and can_run(self.mode, now)
        flyable = can_run(self.user_mode, now) and (now.remote or self.user_mode not in NEEDS_PILOT)
        healthy = not now.preflight_failures and now.battery_warning < failsafe.CRITICAL
        return self.checked(now) and self.user_mode not in NO_ARMING and flyable and healthy and not self.wrecked

    def checked(self, now: FailsafeFlags) -> bool:
        """Return whether the first checks after the boot are over."""
        return now.now_s >= self._checks_pass_s

    def system_status(self, now: FailsafeFlags) -> SystemStatus:
        """Return MAV_STATE for HEARTBEAT.system_status."""
        if self.armed:
            return SystemStatus.FAILSAFE if self.failsafe else SystemStatus.ACTIVE
        return SystemStatus.STANDBY if self.can_arm(now) else SystemStatus.NOT_READY

    def base_mode(self, now: FailsafeFlags) -> int:
        """Return HEARTBEAT.base_mode; OFFBOARD has neither the auto nor the guided bit."""
        bits = CUSTOM_MODE_ENABLED | (SAFETY_ARMED if self.armed else 0)
        if self.mode is Mode.OFFBOARD:
            return bits | (STABILIZE if now.offboard_attitude else 0)
        bits |= GUIDED_OR_AUTO if self.mode.is_auto else MANUAL_INPUT
        return bits | (0 if self.mode is Mode.ACRO else STABILIZE)

    def _say(self, severity: Severity, text: str) -> None:
        self.texts.append(Text(severity, text + "\t"))

    # -- commands --------------------------------------------------------------------------------

    def arm_disarm(self, arm: float, force: float, now: FailsafeFlags) -> Result | None:
        """Handle COMPONENT_ARM_DISARM; return None where PX4 sends no ACK."""
        forced = force == FORCE_MAGIC
        if arm == 1.0:
            return self._arm(forced, now)
        if arm == 0.0:
            return self._disarm_by_command(forced, now)
        self._say(Severity.CRITICAL, f"Unsupported ARM_DISARM param: {arm:.3f}")
        return None

    def _arm(self, forced: bool, now: FailsafeFlags) -> Result:
        if self.armed:
            return Result.ACCEPTED
        if self.wrecked or (not forced and not self.can_arm(now)):
            self._say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        self.armed, self.armed_at_s, self.flown, self._landed_at_s = True, now.now_s, False, None
        self.check_now()
        self._failsafe.arm(now)
        self._say(Severity.INFO, "Armed by external command")
        if not self._logs:
            self._say_log(now.now_s)
        return Result.ACCEPTED

    def _say_log(self, now_s: float) -> None:
        minutes, seconds = divmod(int(now_s), 60)
        hours, minutes = divmod(21 * 60 + minutes, 60)
        self._say(Severity.INFO, LOG_NAME.format(hours % 24, minutes, seconds))
        self._logs = True

    def _disarm_by_command(self, forced: bool, now: FailsafeFlags) -> Result:
        if not self.armed:
            return Result.ACCEPTED
        if not forced and not now.landed:
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.disarm("Disarmed by external command")
        return Result.ACCEPTED

    def disarm(self, text: str) -> None:
        """Stop the motors, also in the air, and go back to the last mode that allows arming; send `text`."""
        self.armed = self._logs = False
        self._failsafe.disarm()
        self.user_mode = self._after_disarm
        self.check_now()
        self._say(Severity.INFO, text)

    def wreck(self, text: str) -> None:
        """Stop the motors and deny arming from now on; send `text`."""
        if self.armed:
            self.disarm("Disarmed by collision")
        self.wrecked = True
        self.texts.append(Text(Severity.EMERGENCY, text + "\t"))

    def set_mode(self, base_mode: int, main: int, sub: int, now: FailsafeFlags) -> Result:
        """Handle DO_SET_MODE; return the commander's answer (the link has already sent ACCEPTED)."""
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

    def choose(self, mode: Mode, now: FailsafeFlags) -> Result:
        """Change to the user's mode from the next step on; while armed only to one that can be flown."""
        if self.armed and not self._may_choose(mode, self.last_checks(now)):
            self._say(Severity.CRITICAL, f"Switching to {mode.title} is currently not available")
            return Result.TEMPORARILY_REJECTED
        self.take(mode)
        return Result.ACCEPTED

    def _may_choose(self, mode: Mode, checked: FailsafeFlags) -> bool:
        flyable = can_run(mode, checked)
        if mode is Mode.POSITION:
            flyable = can_run(Mode.ALTITUDE, checked)  # in which it is flown until there is a position again
        return flyable and (checked.remote or mode not in NEEDS_PILOT)

    def take(self, mode: Mode) -> None:
        """Make this the user's mode, whether it can be flown or not."""
        self.user_mode, self._just_chose, self._ever_chose = mode, True, True
        self.check_now()
        if mode not in NO_ARMING:
            self._after_disarm = mode

    def on_sticks(self, now: FailsafeFlags) -> None:
        """React to the sticks: the first input makes Position the initial mode, moved sticks take over."""
        if not self._ever_chose and not self.armed:
            self.take(Mode.POSITION)
        bit = OVERRIDE_OFFBOARD if self.mode is Mode.OFFBOARD else OVERRIDE_AUTO if self.mode.is_auto else 0
        if not (self.armed and now.sticks_moved and int(self._params["COM_RC_OVERRIDE"]) & bit):
            return
        if self.failsafe:
            self._failsafe.take_over()
            self.take(Mode.POSITION)
        elif self._may_choose(Mode.POSITION, now):
            self.take(Mode.POSITION)
            self._say(Severity.INFO, "Pilot took over using sticks")

    # -- every tick ------------------------------------------------------------------------------

    def step(self, now: FailsafeFlags) -> None:
        """Detect take-off and landing, run checks and failsafes, disarm after landing."""
        self._watch_ground(now)
        checked = self._check(now)
        if self.armed:
            self._watch_failsafe(checked)
        if self.armed:
            self._disarm_when_done(now)
        if not self.armed:
            self.mode = self.user_mode
        self.intended_mode, self._just_chose = self.user_mode, False

    def last_checks(self, now: FailsafeFlags) -> FailsafeFlags:
        """Return the flags at the last checks, which chose the mode that is flown; `now` before the first."""
        return self._checked or now

    @property
    def battery_low(self) -> bool:
        """Return whether the last checks found the battery low, or worse."""
        return self._checked is not None and self._checked.battery_warning > 0

    @property
    def misses_setpoints(self) -> bool:
        """Return whether the last checks found no setpoints; PX4 checks again at once with the first one."""
        return self._checked is not None and not self._checked.offboard_ok

    def check_now(self) -> None:
        """Run the next checks with the next step."""
        self._check_due_s = 0.0

    def _check(self, now: FailsafeFlags) -> FailsafeFlags:
        """Check what the modes need, at 10 Hz and after a change of the state; report changes."""
        if self._checked is None or now.now_s >= self._check_due_s - 1e-9:
            self._check_due_s = now.now_s + CHECK_PERIOD_S
            warning = max(now.battery_warning, self._checked.battery_warning if self._checked and self.armed else 0)
            self._checked = replace(now, battery_warning=warning)
            self._report(self._checked)
        return self._checked

    def _report(self, checked: FailsafeFlags) -> None:
        """Report all failed checks whenever one of them has changed."""
        failures = () if self.armed else checked.preflight_failures
        found = (checked.battery_warning, failures, checked.offboard_ok)
        if found == self._reported:
            return
        self._reported = found
        if checked.battery_warning:
            self._say(*BATTERY_TEXTS[checked.battery_warning])
        self.texts += [Text(Severity.CRITICAL, PREFLIGHT_TEXT.format(failure)) for failure in failures]

    def _watch_ground(self, now: FailsafeFlags) -> None:
        if self._was_landed and not now.landed and self.armed:
            self.flown, self._landed_at_s = True, None
            self._say(Severity.INFO, "Takeoff detected")
        if not self._was_landed and now.landed and self.armed:
            self._landed_at_s = now.now_s
            self._say(Severity.INFO, "Landing detected")
        self._was_landed = now.landed

    def _watch_failsafe(self, checked: FailsafeFlags) -> None:
        before = self._failsafe.action
        action = self._failsafe.select(self.user_mode, self._just_chose, checked)
        if action > max(before, Action.WARN):
            self._say(Severity.CRITICAL, self._failsafe_text())
        if action is Action.DISARM:
            self.disarm("Disarmed by failsafe")
        self.mode = failsafe.MODE_OF.get(action, self.user_mode)

    def _failsafe_text(self) -> str:
        if self._failsafe.delays:
            return f"Failsafe activated, entering Hold for {self._params['COM_FAIL_ACT_T']:.0f} seconds"
        return "Failsafe activated"

    def _disarm_when_done(self, now: FailsafeFlags) -> None:
        after_landing_s = self._params["COM_DISARM_LAND"]
        preflight_s = self._params["COM_DISARM_PRFLT"]
        if self._landed_at_s is not None:
            if after_landing_s > 0.0 and now.now_s - self._landed_at_s >= after_landing_s:
                self.disarm("Disarmed by landing")
        elif not self.flown and 0.0 < preflight_s <= now.now_s - self.armed_at_s - PREFLIGHT_DISARM_EXTRA_S + 1e-9:
            self.disarm("Disarmed by auto preflight disarming")
