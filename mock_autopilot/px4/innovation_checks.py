"""PX4's checks of external poses against the estimate of a vehicle at rest; pure.

Source: estimatorCheck.cpp and EKF2.cpp of PX4 v1.17, which fail a check at half its test ratio, with a gate of
EKF2_EVP_GATE (5) standard deviations. Of several failed checks only the first is reported.
"""

import math

from mock_autopilot.px4.setpoint import Triple

HORIZONTAL_UNSTABLE, HEIGHT_UNSTABLE = "horizontal position unstable", "height estimate not stable"
UNSTABLE_M = 0.5
"""Distance from the estimate that fails a check."""
FAILS_AFTER_S, FAILS_FOR_S = 0.2, 4.0
"""PX4 filters the check: delay until it fails, and duration."""


class InnovationChecks:
    """The checks of horizontal position and height, from pose to pose."""

    def __init__(self) -> None:
        self._away_since_s = dict.fromkeys((HORIZONTAL_UNSTABLE, HEIGHT_UNSTABLE), math.inf)
        self._until_s = dict.fromkeys((HORIZONTAL_UNSTABLE, HEIGHT_UNSTABLE), -math.inf)

    def update(self, seen_m: Triple, estimated_m: Triple, now_s: float, *, applies: bool) -> None:
        """Check one pose (NED, m) against the estimate; `applies` while the vehicle is at rest and flies by poses."""
        off_m = {
            HORIZONTAL_UNSTABLE: math.dist(seen_m[:2], estimated_m[:2]),
            HEIGHT_UNSTABLE: abs(seen_m[2] - estimated_m[2]),
        }
        for check, away_m in off_m.items():
            away = applies and away_m > UNSTABLE_M
            self._away_since_s[check] = min(self._away_since_s[check], now_s) if away else math.inf
            if now_s - self._away_since_s[check] >= FAILS_AFTER_S:
                self._until_s[check] = now_s + FAILS_FOR_S

    def failures(self, now_s: float) -> tuple[str, ...]:
        """Return the check that fails now, in PX4's words; empty when none does."""
        return tuple(check for check, until_s in self._until_s.items() if now_s < until_s)[:1]
