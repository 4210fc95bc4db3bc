"""PX4's simulated battery: it drains while armed and is full again when disarmed."""

from mock_autopilot.params import ParamTable


class Battery:
    """Charge 0..1; SIM_BAT_DRAIN seconds take it from full to SIM_BAT_MIN_PCT, as recorded from PX4 v1.17."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.charge = 1.0
        self._full = 1.0

    def drop_to(self, charge: float) -> None:
        """A pack that is suddenly worth no more than this share; it does not recover."""
        self._full = min(self._full, charge)
        self.charge = min(self.charge, charge)

    def step(self, armed: bool, dt_s: float) -> None:
        """Drain for `dt_s`, or recharge at once on the ground."""
        if not armed:
            self.charge = self._full
            return
        least = self._params["SIM_BAT_MIN_PCT"] / 100.0
        drained = dt_s * (1.0 - least) / max(self._params["SIM_BAT_DRAIN"], 1.0)
        self.charge = max(self.charge - drained, min(least, self._full))

    @property
    def voltage_v(self) -> float:
        """Pack voltage (V), linear in the charge between the empty and the charged cell."""
        empty, full = self._params["BAT1_V_EMPTY"], self._params["BAT1_V_CHARGED"]
        return self._params["BAT1_N_CELLS"] * (empty + self.charge * (full - empty))

    @property
    def percent(self) -> int:
        """Remaining charge, 0..100."""
        return round(100.0 * self.charge)
