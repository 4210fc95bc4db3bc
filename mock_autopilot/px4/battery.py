"""PX4's simulated battery: it drains while armed and is full again when disarmed."""

import math

from mock_autopilot.px4.failsafe import CRITICAL, EMERGENCY, LOW
from mock_autopilot.px4.params import ParamTable

FILTER_REST = 1e-6
"""Percent by which the filtered charge stays above the true one."""
REPORT_S = 1.0
"""PX4 filters the state of charge; recorded with 0.95 to 1.05 s."""


class Battery:
    """Charge 0..1; SIM_BAT_DRAIN seconds would empty it, at SIM_BAT_MIN_PCT it stops, as recorded from PX4 v1.17."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.charge = 1.0
        self._full = 1.0
        self._reported = 1.0

    def drop_to(self, charge: float) -> None:
        """Limit the charge to this share (0..1) from now on; it does not recover."""
        self._full = min(self._full, charge)
        self.charge = self._reported = min(self.charge, charge)

    def step(self, armed: bool, dt_s: float) -> None:
        """Drain for `dt_s`, or recharge at once on the ground."""
        if armed:
            least = self._params["SIM_BAT_MIN_PCT"] / 100.0
            drained = dt_s / max(self._params["SIM_BAT_DRAIN"], 1.0)
            self.charge = max(self.charge - drained, min(least, self._full))
        else:
            self.charge = self._full
        self._reported += (self.charge - self._reported) * min(dt_s / REPORT_S, 1.0)

    @property
    def voltage_v(self) -> float:
        """Return the pack voltage (V), linear in the charge between the empty and the charged cell."""
        empty, full = self._params["BAT1_V_EMPTY"], self._params["BAT1_V_CHARGED"]
        return self._params["BAT1_N_CELLS"] * (empty + self.charge * (full - empty))

    @property
    def percent(self) -> int:
        """Return the remaining charge as reported, 0..100: rounded up, as PX4's SYS_STATUS has it.

        Its filter stays just above the charge at which a simulated battery stops: 51 % for 50 %.
        """
        return min(math.ceil(100.0 * self._reported + FILTER_REST), 100)

    @property
    def warning(self) -> int:
        """Return 0 or one of LOW, CRITICAL, EMERGENCY, by BAT_LOW_THR and its like."""
        levels = ((EMERGENCY, "BAT_EMERGEN_THR"), (CRITICAL, "BAT_CRIT_THR"), (LOW, "BAT_LOW_THR"))
        return next((level for level, name in levels if self._reported < self._params[name]), 0)
