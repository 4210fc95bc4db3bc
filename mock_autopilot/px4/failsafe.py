"""PX4's failsafe state machine (commander/failsafe, v1.17), as far as this vehicle has causes for it; pure.

Each cause asks for an action, the worst is taken, and one that cannot be flown falls back to the next.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.vocabulary import Mode


class Action(IntEnum):
    """The actions of a failsafe, mildest first, as in PX4."""

    NONE = 0
    WARN = 1
    POSITION = 2
    ALTITUDE = 3
    HOLD = 5
    RETURN = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9


MODE_OF = {
    Action.POSITION: Mode.POSITION,
    Action.ALTITUDE: Mode.ALTITUDE,
    Action.HOLD: Mode.HOLD,
    Action.RETURN: Mode.RTL,
    Action.LAND: Mode.LAND,
    Action.DESCEND: Mode.DESCEND,
}
FALLBACKS = (Action.POSITION, Action.ALTITUDE, Action.HOLD, Action.RETURN, Action.LAND)
"""Tried in this order, from the selected one on; PX4 would try Stabilized too, which the mock does not have."""
OFFBOARD_LOSS = {
    0: Action.POSITION,
    1: Action.ALTITUDE,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.DISARM,
    7: Action.DISARM,
}
"""COM_OBL_RC_ACT. 6 terminates, which stops the motors of a quadrotor as well; 2 (Stabilized) counts as Altitude."""
LINK_LOSS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.DISARM, 6: Action.DISARM}
"""NAV_RCL_ACT; anything else does nothing."""
LINK_LOSS_EXCEPT = {Mode.MISSION: 1, Mode.OFFBOARD: 4}
"""Bits of COM_RCL_EXCEPT; all modes the autopilot flies by itself have 2."""
LOW, CRITICAL, EMERGENCY = 1, 2, 3
"""Battery warnings."""
TAKEOVER = frozenset({Action.HOLD, Action.RETURN, Action.LAND, Action.DESCEND})
"""Failsafes that a pilot may end by choosing a mode."""


@dataclass(frozen=True, kw_only=True)
class FailsafeFlags:
    """The conditions from which the commander decides (PX4's failsafe_flags and vehicle_status)."""

    now_s: float
    landed: bool
    local_ok: bool
    global_ok: bool
    offboard_ok: bool
    """Setpoints came within COM_OF_LOSS_T."""
    offboard_attitude: bool
    """The last setpoint asked for attitude control."""
    remote: bool = False
    """A pilot's sticks are received."""
    sticks_moved: bool = False
    battery_warning: int = 0
    preflight_failures: tuple[str, ...] = ()
    """Failed checks of the estimate of a vehicle that is disarmed, in PX4's words."""


def can_run(mode: Mode, now: FailsafeFlags) -> bool:
    """Return whether a mode has the estimates and signals it needs; a missing pilot is checked elsewhere."""
    if mode is Mode.OFFBOARD:
        return now.offboard_ok
    if mode is Mode.MISSION:
        return False
    if mode in {Mode.HOLD, Mode.RTL}:
        return now.local_ok and now.global_ok
    needs_position = mode in {Mode.POSITION, Mode.TAKEOFF, Mode.LAND}
    return now.local_ok or not needs_position


class Failsafe:
    """The state machine from arming to disarming."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.action = Action.NONE
        self._remote_optional = True
        self._remote_failed: Action | None = None
        self._battery_at_arming = 0
        self._user_mode: Mode | None = None
        self._taken_over = False
        self._delay_until_s = -math.inf
        self._serious: set[str] = set()

    def arm(self, now: FailsafeFlags) -> None:
        """Start watching; a pilot or charge that is missing at arming is optional from then on."""
        self._clear()
        self._remote_optional, self._battery_at_arming = not now.remote, now.battery_warning

    def disarm(self) -> None:
        """Reset the state machine when the vehicle is disarmed."""
        self._clear()

    def _clear(self) -> None:
        self.action, self._remote_failed, self._taken_over = Action.NONE, None, False
        self._user_mode, self._delay_until_s = None, -math.inf
        self._serious.clear()

    def select(self, user_mode: Mode, mode_chosen: bool, now: FailsafeFlags) -> Action:
        """Return the action for this moment; `mode_chosen`: a user has just asked for a mode."""
        chosen = self._user_mode is not None and (mode_chosen or user_mode is not self._user_mode)
        self._user_mode = user_mode
        if chosen or self._taken_over:
            self._remote_failed = None
        causes = {"remote": self._on_remote(user_mode, now), "battery": self._on_battery(now)}
        self._notice_new(causes, now)
        fallback = mode_fallback(user_mode, self._params, now)
        wanted = max(*causes.values(), fallback)
        delayed = now.now_s < self._delay_until_s and not self._taken_over and Action.WARN < wanted < Action.DISARM
        if delayed:
            wanted = Action.HOLD
        self._taken_over = wanted in TAKEOVER and (self._taken_over or (chosen and wanted is self.action))
        if self._taken_over:
            wanted = max(Action.WARN, fallback)
        self.action = _flyable(wanted, user_mode, now)
        return self.action

    def _on_remote(self, user_mode: Mode, now: FailsafeFlags) -> Action:
        """Return the action for lost sticks; it stays until a mode is chosen."""
        if now.remote:
            self._remote_optional = False
        excepted = int(self._params["COM_RCL_EXCEPT"]) & LINK_LOSS_EXCEPT.get(user_mode, 2 if user_mode.is_auto else 0)
        off = int(self._params["COM_RC_IN_MODE"]) == 4 or excepted or self._remote_optional
        if not now.remote and not off:
            self._remote_failed = LINK_LOSS.get(int(self._params["NAV_RCL_ACT"]), Action.NONE)
        return self._remote_failed or Action.NONE

    def _on_battery(self, now: FailsafeFlags) -> Action:
        """Return the action for a low battery: warn, or COM_LOW_BAT_ACT unless it was as low at arming."""
        action = int(self._params["COM_LOW_BAT_ACT"])
        if now.battery_warning <= LOW or now.battery_warning <= self._battery_at_arming or action == 0:
            return Action.WARN if now.battery_warning else Action.NONE
        if action == 2 or (action == 3 and now.battery_warning >= EMERGENCY):
            return Action.LAND
        return Action.RETURN

    def _notice_new(self, causes: dict[str, Action], now: FailsafeFlags) -> None:
        """End a pilot's takeover at a new cause, and hold for COM_FAIL_ACT_T first where Hold can be flown."""
        serious = {cause for cause, action in causes.items() if action > Action.WARN}
        wait_s = self._params["COM_FAIL_ACT_T"]
        if serious - self._serious:
            self._taken_over = False
            if wait_s > 0.1 and now.now_s >= self._delay_until_s:
                self._delay_until_s = now.now_s + wait_s
        self._serious = serious
        if not serious or self.action > Action.HOLD or self._taken_over or not can_run(Mode.HOLD, now):
            self._delay_until_s = -math.inf

    def take_over(self) -> None:
        """Let a pilot who moves the sticks end a failsafe that flies by itself."""
        self._taken_over = self.action in TAKEOVER

    @property
    def delays(self) -> bool:
        """Return whether it holds before its action begins."""
        return self.action is Action.HOLD and math.isfinite(self._delay_until_s)


def mode_fallback(user_mode: Mode, params: ParamTable, now: FailsafeFlags) -> Action:
    """Return the action when the user's mode cannot be flown, else NONE."""
    action, mode = Action.NONE, user_mode
    if mode is Mode.OFFBOARD and not now.offboard_ok:
        action = OFFBOARD_LOSS.get(int(params["COM_OBL_RC_ACT"]), Action.ALTITUDE)
        if action is Action.DISARM:
            return action
        mode = MODE_OF[action]
        if action in {Action.POSITION, Action.ALTITUDE} and not now.remote:
            action = Action.RETURN  # nobody there to fly it
    if mode is Mode.POSITION and not can_run(mode, now):
        return Action.ALTITUDE
    return action if can_run(mode, now) else max(action, Action.RETURN)


def _flyable(wanted: Action, user_mode: Mode, now: FailsafeFlags) -> Action:
    """Return the first action from `wanted` on that can be flown."""
    if wanted in FALLBACKS:
        rest = FALLBACKS[FALLBACKS.index(wanted) :]
        wanted = next((action for action in rest if can_run(MODE_OF[action], now)), Action.DESCEND)
    landing = user_mode is Mode.LAND and can_run(Mode.LAND, now)
    return Action.WARN if wanted is Action.RETURN and landing else wanted
