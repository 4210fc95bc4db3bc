"""Tolerances of each event's time: the spread among recordings of the same event.

Where a message is sent at a fixed rate, its period is added: the same change may just miss one sample.
"""

import re
from dataclasses import dataclass

from tests.mock_autopilot.reenact.events import Event


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The accepted interval before and after the expected time, and the reason."""

    early_s: float
    late_s: float
    source: str
    optional: bool = False
    """PX4 reports it in some boots and not in others."""


def _around(half_s: float, source: str) -> Tolerance:
    return Tolerance(early_s=half_s, late_s=half_s, source=source)


ANSWER = _around(0.02, "ACKs come 1 to 16 ms after the command, and the mock ticks in 4 ms")
SAMPLED_5HZ = _around(0.25, "sent at 5 Hz")
SAMPLED_1HZ = _around(1.1, "sent at 1 Hz")
BY_CHANCE = Tolerance(early_s=2.1, late_s=2.1, optional=True, source="in 4 of 14 boots")
LANDING = _around(0.96, "5.18 to 6.14 s after a descent from 1 m began, in five flights")
DISARMING = _around(0.96, "2.00 s after Landing detected")
UNREADY = Tolerance(early_s=0.8, late_s=0.25, source="0.56 to more than 1.33 s after the setpoints")
RULES: tuple[tuple[str, str, Tolerance], ...] = (
    ("STATUSTEXT", "Takeoff detected", _around(0.35, "1.2 to 1.9 s after arming")),
    ("STATUSTEXT", "Failsafe activated", _around(0.05, "0.593 to 0.605 s after the setpoints, 4.59 to 4.60 s after the "
        "last pose, 0.64 s after the last stick message")),
    ("STATUSTEXT", "battery", _around(1.3, "two percent of the charge, and told at 1 Hz")),
    ("STATUSTEXT", "logger", Tolerance(early_s=0.06, late_s=0.06, optional=True, source="after 13 of 14 armings")),
    ("STATUSTEXT", "Preflight Fail", Tolerance(early_s=0.3, late_s=0.3, optional=True,
        source="0.24 s after the poses had come back in one of two sessions")),
    ("STATUSTEXT", "Landing detected", LANDING),
    ("STATUSTEXT", "Disarmed by landing", DISARMING),
    ("STATUSTEXT", "Disarmed by external", _around(1.6, "granted 0.5 to 2.1 s after the first question")),
    ("STATUSTEXT", "", _around(0.06, "texts come 1 to 60 ms after their cause")),
    ("COMMAND_ACK", "ARM_DISARM", _around(0.06, "with the text, which comes within 60 ms")),
    ("COMMAND_ACK", "", ANSWER),
    ("reply", "", ANSWER),
    ("PARAM_VALUE", "", _around(0.05, "answers to a burst of questions")),
    ("CURRENT_MODE", r"wanted \d+/\d+$", Tolerance(early_s=0.09, late_s=0.06,
        source="as its text, and told 0.004 to 0.039 s after it")),
    ("CURRENT_MODE", "", _around(0.06, "told within 60 ms")),
    ("COMMAND_LONG", "", _around(0.6, "repeated after 0.5 to 1.0 s")),
    ("HEARTBEAT", "", SAMPLED_1HZ),
    ("EXTENDED_SYS_STATE", "on ground", _around(2.0, "as Landing detected, and sent at 1 Hz")),
    ("EXTENDED_SYS_STATE", "", SAMPLED_1HZ),
    ("ESTIMATOR_STATUS", "128", _around(2.7, "0.9 to 3.5 s after disarming, and sent at 1 Hz")),
    ("ESTIMATOR_STATUS", "", SAMPLED_1HZ),
    ("BATTERY_STATUS", "", _around(2.1, "sent at 0.5 Hz")),
    ("SYS_STATUS", "AHRS|ATTITUDE_STABILIZATION", BY_CHANCE),
    ("SYS_STATUS", "BATTERY", _around(1.3, "as the text")),
    ("SYS_STATUS", "-PREARM", UNREADY),
    ("SYS_STATUS", "", SAMPLED_5HZ),
    ("battery", "", _around(1.3, "two percent, and sent at 5 Hz")),
)  # fmt: skip


def tolerance_of(event: Event) -> Tolerance:
    """Return the rule of an event."""
    return next(
        tolerance
        for channel, pattern, tolerance in RULES
        if channel == event.channel and re.search(pattern, event.what)
    )
