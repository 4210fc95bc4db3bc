"""Numbers of the link to a law on the ground: messages, bytes, ages, losses, silence. Pure."""

from dataclasses import dataclass

import numpy as np

from companion.analysis.report.recorded_flight import Flown, Mask
from companion.analysis.summary import grown_by, message_ages_s

COUNTED = "link_messages"
"""Column that a record of a vehicle has if its law was on the ground."""
LIMITS = {
    "late": "command_late_s",
    "held until": "command_coast_s",
    "level": "command_level_s",
    "PX4 lands": "command_silent_s",
}
"""Effects of a silent ground law, and their keys in [safety]."""


@dataclass(frozen=True, kw_only=True)
class LinkNumbers:
    """Traffic of the link over some cycles."""

    name: str
    duration_s: float
    cycles_per_s: float
    messages_per_s: float
    """Sent by the ground, lost ones included."""
    events: int
    """New commands."""
    again: int
    """Commands sent again, because they were not acknowledged."""
    beats: int
    """Messages without a command."""
    lost: int
    bytes_per_s: float
    """Payload with tags."""
    messages_down_per_s: float
    bytes_down_per_s: float
    age_median_s: float
    """Age of a message at its arrival."""
    age_p99_s: float
    age_max_s: float
    silence_max_s: float
    """Longest time that a cycle had a command for which the ground had not confirmed."""


def link_numbers(flown: Flown) -> tuple[LinkNumbers, ...]:
    """Return the numbers of each trajectory and of the time in the air; none for a law on board."""
    if not flown.has(COUNTED) or not flown.airborne.any():
        return ()
    scopes = [(one.name, one.mask) for one in flown.trajectories] + [("in the air", flown.airborne)]
    return tuple(_over(flown, name, among) for name, among in scopes)


def _over(flown: Flown, name: str, among: Mask) -> LinkNumbers:
    time_s = flown.time_s[among]
    duration_s = max(float(time_s[-1] - time_s[0]), 1e-9)

    def grown(column: str) -> int:
        return grown_by(flown.record.columns, column, among)

    ages_s = message_ages_s(flown.record.columns, among)
    ages_s = ages_s[np.isfinite(ages_s)]
    median_s, p99_s, max_s = np.percentile(ages_s, [50.0, 99.0, 100.0]).tolist() if ages_s.size else [np.nan] * 3
    return LinkNumbers(
        name=name,
        duration_s=duration_s,
        cycles_per_s=float(among.sum()) / duration_s,
        messages_per_s=grown(COUNTED) / duration_s,
        events=grown("link_events"),
        again=grown("link_again"),
        beats=grown("link_beats"),
        lost=grown("link_lost"),
        bytes_per_s=grown("link_bytes") / duration_s,
        messages_down_per_s=grown("link_messages_down") / duration_s,
        bytes_down_per_s=grown("link_bytes_down") / duration_s,
        age_median_s=median_s,
        age_p99_s=p99_s,
        age_max_s=max_s,
        silence_max_s=float(np.nanmax(flown.column("link_command_age_s")[among])),
    )


def limits_of(flown: Flown) -> dict[str, float]:
    """Return the configured limits of silence (s) by their effects, as far as the record has them."""
    safety = (flown.record.metadata.get("config") or {}).get("safety") or {}
    return {effect: float(safety[key]) for effect, key in LIMITS.items() if isinstance(safety.get(key), int | float)}


def side_of(flown: Flown) -> str:
    """Return the side of the link that has recorded the flight, with its sessions; empty for a law on board."""
    if not flown.has("link_session"):
        return ""
    sessions = [f"{session:.0f}" for session in np.unique(flown.column("link_session")) if session > 0.0]
    side = "ground" if flown.record.is_of_ground else "vehicle"
    merged = ", with the ground's record" if flown.record.ground is not None else ""
    return f"{side}{merged}; session {', '.join(sessions) or 'none'}"
