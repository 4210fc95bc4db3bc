"""A pilot's sticks from MANUAL_CONTROL (a joystick on a ground station): PX4's manual_control module; pure."""

import math

from mock_autopilot.px4.params import ParamTable

LOOK_PERIOD_S = 0.2
"""Period at which PX4 checks for lost sticks."""
FILTER_S = 0.1
"""Time constant of the speed of a stick."""
NO_JOYSTICK = frozenset({0, 4})
"""COM_RC_IN_MODE: a receiver only, nothing at all."""


class Sticks:
    """The sticks' positions (roll, pitch, yaw -1..1, throttle), their speed, and the time of the last input."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self._heard_s = -math.inf
        self._last: tuple[float, ...] | None = None
        self._speed = [0.0] * 4
        self.moved = False
        """Moved faster than COM_RC_STICK_OV since `moved` was reset."""

    def update(self, sticks: tuple[float, float, float, float], now_s: float) -> bool:
        """Process one input (pitch, roll, throttle -1..1, yaw); return whether COM_RC_IN_MODE accepts joysticks."""
        if int(self._params["COM_RC_IN_MODE"]) in NO_JOYSTICK:
            return False
        dt_s = now_s - self._heard_s
        if self._last is not None and self.there(now_s) and dt_s > 1e-6:
            share = dt_s / (dt_s + FILTER_S)
            for axis, (value, before) in enumerate(zip(sticks, self._last, strict=True)):
                self._speed[axis] += share * ((value - before) / dt_s - self._speed[axis])
            self.moved |= max(map(abs, self._speed)) > self._params["COM_RC_STICK_OV"] / 100.0
        else:
            self._speed = [0.0] * 4
        self._last, self._heard_s = sticks, now_s
        return True

    def there(self, now_s: float) -> bool:
        """Return whether input is present: it is lost after COM_RC_LOSS_T, noticed at the next check."""
        if self._last is None:
            return False
        looks = math.ceil(self._params["COM_RC_LOSS_T"] / LOOK_PERIOD_S - 1e-6)
        return now_s - self._heard_s < looks * LOOK_PERIOD_S
