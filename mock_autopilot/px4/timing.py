"""Times that differ from boot to boot and from answer to answer, drawn as often as recorded from PX4 v1.17; pure."""

import numpy as np

SEED = 1219
"""Beside the world's own seed, so that what else is random does not depend on these draws. With this one the worlds
1 to 8 boot as most recorded ones did, and the ninth as the others."""

CHECKS_S, CHECKS_SPREAD_S = 4.0, 0.3
"""Boot to arming: 3.0 to 3.3 s after the first HEARTBEAT, which comes at 1.0 s, in nine of twelve recorded boots."""
CHECKS_LATER_S, CHECKS_LATER_SHARE = 2.0, 0.25
"""Later by so much in the other three."""
OWN_LANDINGS = ((0.68, 0.76), (0.90, 1.25), (1.90, 2.25))
OWN_LANDING_SHARES = (5 / 9, 2 / 9, 2 / 9)
"""Idle thrust in OFFBOARD to "landed", of LNDMC_TRIG_TIME: nine recorded landings, asked every half second."""
LANDINGS = ((1.2, 1.3), (1.75, 1.9))
LANDING_SHARES = (0.6, 0.4)
"""The same from low throttle where PX4 itself lands: touchdown to "landed" 1.2 to 1.6 s in three of five flights, 2.2
and 2.3 s in the others."""
LANDING_GPS = 2.7
"""With GPS and a range finder that did not count PX4 took three times as long for each stage."""
RANGE_DOUBT_SHARE, RANGE_DOUBT_AFTER_S, RANGE_DOUBT_S = 0.75, (1.2, 2.6), (1.0, 3.0)
"""In nine of twelve recorded flights ESTIMATOR_STATUS lost its bit 64 so long after take-off, for so long."""
LANDED_DOUBT_SHARE, LANDED_DOUBT_S = 0.5, (1.0, 4.0)
"""And in half of them at the landing."""
RATIO_SPREAD = 0.8
"""Standard deviation of the logarithm of ESTIMATOR_STATUS's test ratios in flight."""
RETURN_TEXTS_S = ((0.053, 0.06), (0.149, 0.2))
"""Time from "start return" to "land at destination": three of four recorded pairs, and the fourth."""


class Timing:
    """Draws of one simulated world."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, SEED])
        self._shown_rng = np.random.default_rng([seed, SEED, 1])

    def checks_pass_s(self) -> float:
        """Return how long after this boot the arming checks can pass, s."""
        later = self._rng.random() < CHECKS_LATER_SHARE
        return CHECKS_S + self._rng.uniform(0.0, CHECKS_SPREAD_S) + (CHECKS_LATER_S if later else 0.0)

    def land_stages(self, climb_controlled: bool, has_gps: bool) -> float:
        """Return how long this landing takes to be noticed, in LNDMC_TRIG_TIME."""
        if climb_controlled and has_gps:
            return LANDING_GPS
        spans, shares = (LANDINGS, LANDING_SHARES) if climb_controlled else (OWN_LANDINGS, OWN_LANDING_SHARES)
        least, most = spans[int(self._rng.choice(len(spans), p=shares))]
        return float(self._rng.uniform(least, most))

    def range_doubt_s(self, taking_off: bool) -> tuple[float, float]:
        """Return when from now on, s, the range finder is doubted: from, until; never in some flights."""
        share, lasts_s = (RANGE_DOUBT_SHARE, RANGE_DOUBT_S) if taking_off else (LANDED_DOUBT_SHARE, LANDED_DOUBT_S)
        if self._shown_rng.random() > share:
            return 0.0, 0.0
        from_s = float(self._shown_rng.uniform(*RANGE_DOUBT_AFTER_S)) if taking_off else 0.0
        return from_s, from_s + float(self._shown_rng.uniform(*lasts_s))

    def ratio(self, median: float, most: float) -> float:
        """Return a test ratio of the estimator around its median, up to its recorded most."""
        return min(median * float(np.exp(RATIO_SPREAD * self._shown_rng.standard_normal())), most)

    def return_text_s(self) -> float:
        """Return how long after the first text of Return the second one comes, s."""
        low_s, high_s = RETURN_TEXTS_S[int(self._rng.random() < 0.25)]
        return float(self._rng.uniform(low_s, high_s))
