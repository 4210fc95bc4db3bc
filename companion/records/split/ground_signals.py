"""Internal signals of a law on the ground, in the cycles of the vehicle. Pure."""

import numpy as np

_SIGNAL = "law_"
_OURS = frozenset({"law_name"})
_LONGEST_S = 0.1
"""Longest time for which a signal stands for the law."""

Columns = dict[str, np.ndarray]


def signals_at(vehicle: Columns, ground: Columns) -> Columns:
    """Return the ground law's signals in each of the vehicle's cycles: those of the ground's newest cycle before it.

    NaN where that is long ago. Both have their times on one clock.
    """
    names = [name for name in ground if name.startswith(_SIGNAL) and name not in _OURS | vehicle.keys()]
    newest = np.searchsorted(ground["time_s"], vehicle["time_s"], side="right") - 1
    known = (newest >= 0) & (vehicle["time_s"] - ground["time_s"][newest] < _LONGEST_S)
    return {name: _where(known, ground[name][newest]) for name in names}


def _where(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.where(known.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
