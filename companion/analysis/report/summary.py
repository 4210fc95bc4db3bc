"""A flight's verdict and two lines of summary, as its page begins. Pure."""

import math

from companion.analysis.report.number_tables import in_the_air
from companion.analysis.report.numbers import Numbers, TrajectoryNumbers
from companion.analysis.report.tables import BAD, GOOD, PLAIN, Cell


def verdict(numbers: Numbers) -> Cell:
    """Return how the flight ended, and what was done about a fault, in a sentence."""
    ended = numbers.ended[:1].upper() + numbers.ended[1:]
    if numbers.story.reactions:
        done = ", then ".join(
            f"{one.reaction} at {one.at_s:.1f} s" + (f" because of {one.cause}" if one.cause else "")
            for one in numbers.story.reactions
        )
        return Cell(f"{ended}. Failsafe: {done}.", BAD)
    if numbers.truncated or numbers.damage or not numbers.over:
        return Cell(f"{ended}.", BAD)
    if not numbers.law_s:
        return Cell(f"{ended}. The law was never in charge.", PLAIN)
    faults = len({one.fault for one in numbers.story.faults})
    noticed = f"{faults} kinds of faults were noticed" if faults > 1 else "one kind of fault was noticed"
    return Cell(f"{ended}. {f'No failsafe acted; {noticed}' if faults else 'No fault'}.", GOOD)


def summary(numbers: Numbers) -> list[str]:
    """Return what was flown and how well, and how often and how fast setpoints were sent."""
    if not numbers.law_s:
        return []
    lines = [_flown(numbers)]
    if (triggers := numbers.triggers_whole) is not None:
        says = [f"Updates in {triggers.sent_share:.0%} of {triggers.cycles} cycles"]
        if math.isfinite(triggers.gap_max_s):
            says.append(f"the longest time between two triggers was {1e3 * triggers.gap_max_s:.0f} ms")
        if (from_frame := numbers.latencies.get("frame to setpoint")) is not None:
            says.append(f"95 % of the setpoints left within {1e3 * from_frame.p95_s:.1f} ms of their frame's arrival")
        lines.append("; ".join(says) + ".")
    return lines


def _flown(numbers: Numbers) -> str:
    if numbers.trajectories:
        return "; ".join(map(_tracked, numbers.trajectories)) + f". In the air {in_the_air(numbers)}."
    whole = numbers.whole
    errors = "" if whole is None else f", mean error {_cm(whole.mean_m[3])}, largest {_cm(whole.max_m[3])}"
    return f"No trajectory; in the air {in_the_air(numbers)}{errors}."


def _tracked(one: TrajectoryNumbers) -> str:
    name = f"{one.name[:1].upper()}{one.name[1:]} by {one.law or 'an unknown law'}"
    if one.errors is None:
        return name
    return f"{name}: mean error {_cm(one.errors.mean_m[3])}, largest {_cm(one.errors.max_m[3])}"


def _cm(value_m: float) -> str:
    return f"{100.0 * value_m:.1f} cm"
