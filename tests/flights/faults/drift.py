"""Drift of PX4's landings without a pose, beside the recorded one."""

from collections.abc import Mapping

import numpy as np

from tests.flights.faults.judge import Result
from tests.flights.faults.rows import When
from tests.flights.faults.table import VIRTUAL

RECORDED_M = (0.4, 1.6)
"""Drifts from a hover at 1 m, PX4 v1.17: 0.47, 0.70 and 1.55 m (docs/px4-conformance.md)."""
ENOUGH = 10
"""Landings from a hover, without which nothing is said of their distribution."""


class Drift:
    """Distribution of the horizontal way, m, in landings that began in a hover, as the recorded ones did."""

    def __init__(self, results: Mapping[str, Result]) -> None:
        hovered = [results[row.name] for row in VIRTUAL if row.when is When.HOVER and row.name in results]
        self._drifts_m = sorted(result.drift_m for result in hovered if result.drift_m is not None)

    @property
    def words(self) -> str:
        """Return the distribution as a line of the summary; empty where there was no such landing."""
        if not self._drifts_m:
            return ""
        least, median, most, last = np.quantile(self._drifts_m, [0.0, 0.5, 0.9, 1.0])
        return (
            f"{len(self._drifts_m)} landings of PX4's from a hover, without a pose, drifted by {least:.2f} to "
            f"{last:.2f} m: median {median:.2f} m, nine of ten up to {most:.2f} m"
        )

    @property
    def problems(self) -> list[str]:
        """Return what is not as recorded: the median within the recorded range, nine of ten not beyond it."""
        if len(self._drifts_m) < ENOUGH:
            return []
        least_m, most_m = RECORDED_M
        median, nine_of_ten = np.quantile(self._drifts_m, [0.5, 0.9])
        ok = least_m <= median <= most_m and nine_of_ten <= most_m
        return [] if ok else [f"{self.words}; recorded: {least_m} to {most_m} m"]
