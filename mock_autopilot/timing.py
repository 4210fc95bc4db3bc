"""Times that differ from boot to boot and from answer to answer, drawn as often as recorded from PX4 v1.17; pure."""

import numpy as np

SEED = 1219
"""Beside the world's own seed, so that what else is random does not depend on these draws. With this one the worlds
1 to 8 boot as most recorded ones did, and the ninth as the others."""

CHECKS_S, CHECKS_SPREAD_S = 4.0, 0.3
"""Boot to arming: 3.0 to 3.3 s after the first HEARTBEAT, which comes at 1.0 s, in nine of twelve recorded boots."""
CHECKS_LATER_S, CHECKS_LATER_SHARE = 2.0, 0.25
"""Later by so much in the other three."""
LINK_TICK_S = 0.004
SECOND_ACK_TICKS = (0, 1, 2, 3)
SECOND_ACK_SHARES = (0.29, 0.24, 0.32, 0.15)
"""Second answer to DO_SET_MODE: 0.1, 4, 8 or 12 ms after the first; of 34 recorded ones."""
RETURN_TEXTS_S = ((0.053, 0.06), (0.149, 0.2))
"""From "start return" to "land at destination": three of four recorded pairs, and the fourth."""


class Timing:
    """Draws of one simulated world."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, SEED])

    def checks_pass_s(self) -> float:
        """Return how long after this boot the arming checks can pass, s."""
        later = self._rng.random() < CHECKS_LATER_SHARE
        return CHECKS_S + self._rng.uniform(0.0, CHECKS_SPREAD_S) + (CHECKS_LATER_S if later else 0.0)

    def second_ack_s(self) -> float:
        """Return how long after the first ACK the second one goes out, s; 0 is at once."""
        return LINK_TICK_S * float(self._rng.choice(SECOND_ACK_TICKS, p=SECOND_ACK_SHARES))

    def return_text_s(self) -> float:
        """Return how long after the first text of Return the second one comes, s."""
        low_s, high_s = RETURN_TEXTS_S[int(self._rng.random() < 0.25)]
        return float(self._rng.uniform(low_s, high_s))
