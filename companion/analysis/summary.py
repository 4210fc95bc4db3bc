"""Numbers of a recorded flight: errors, updates, timing. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.arms.state_machine import ArmPhase
from companion.core.types import Array
from companion.supervisor.flight_state import Phase

Columns = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Spread:
    """Median and 99th percentile of something, in ms."""

    median: float
    p99: float

    def as_dict(self) -> dict[str, float]:
        """Return the values by name, for JSON."""
        return {"median": self.median, "p99": self.p99}


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Key numbers of a flight. Errors per axis x, y, z in W, over the cycles that track the trajectory."""

    mean_error_m: tuple[float, float, float]
    max_error_m: tuple[float, float, float]
    rms_error_m: tuple[float, float, float]
    update_share: float
    """Share of the tracking cycles that sent a new setpoint."""
    control_cycles: int
    """Cycles while tracking."""
    tick_late_ms: Spread
    """Begin of the cycle after the frame's arrival, or after the deadline when no frame came."""
    frame_to_setpoint_ms: Spread | None
    """Time from the arrival of the frame to the setpoint's hand-over to the autopilot's link; None without frames."""
    capture_to_setpoint_ms: Spread | None
    """Time from the capture itself, as far as the clocks can be compared; None without frames."""
    cycles_without_frame: int
    landed: bool
    disarmed: bool
    arms: "ArmSummary | None" = None
    """None for a vehicle without arms."""
    link: "LinkSummary | None" = None
    """None for a law on board."""


@dataclass(frozen=True)
class ArmSummary:
    """Key numbers of the arms and their bus, over the same cycles."""

    moving_share: float
    """Share of the cycles in which a motion ran."""
    largest_off_goal_rad: float
    """Largest difference between a joint's angle and its goal."""
    bus_cycle_ms: Spread
    bad_packets: int
    """Late, broken or missing answers that were requested again."""


@dataclass(frozen=True, kw_only=True)
class LinkSummary:
    """Key numbers of the link to a law on the ground, over the same cycles, as the ground has sent."""

    uplink_bytes_per_s: float
    """Payload with tags, lost messages included."""
    downlink_bytes_per_s: float
    messages_per_s: float
    """Events, beats and repeated commands up; a plain stream has one a cycle."""
    events: int
    beats: int
    again: int
    """Commands that were sent again because they were not acknowledged."""
    lost: int
    age_ms: Spread
    """Age of a message at its arrival."""
    longest_silence_ms: float


def summarise(columns: Columns) -> Summary | None:
    """Return the summary of a recorded flight, or None when it never tracked anything."""
    phase = columns["phase"]
    tracking = phase == str(Phase.TRACK)
    if not tracking.any():
        return None
    error = np.abs(tracking_error_w_m(columns)[tracking])
    sent = columns["sent_s"]
    has_setpoint = tracking & np.isfinite(_floats(sent))
    with_frame = has_setpoint & np.isfinite(_floats(columns["frame_received_s"]))
    to_setpoint = _floats(sent)[with_frame] - _floats(columns["frame_received_s"])[with_frame]
    from_capture = (_floats(sent) - _floats(columns["time_s"]) + _floats(columns["age_s"]))[has_setpoint]
    last = str(phase[-1])
    return Summary(
        mean_error_m=_triple(error.mean(axis=0)),
        max_error_m=_triple(error.max(axis=0)),
        rms_error_m=_triple(np.sqrt((error**2).mean(axis=0))),
        update_share=float(has_setpoint.sum() / tracking.sum()),
        control_cycles=int(tracking.sum()),
        tick_late_ms=spread_ms(_floats(columns["late_s"])[tracking]),
        frame_to_setpoint_ms=spread_ms(to_setpoint) if with_frame.any() else None,
        capture_to_setpoint_ms=spread_ms(from_capture) if with_frame.any() else None,
        cycles_without_frame=int((tracking & ~np.isfinite(_floats(columns["frame_received_s"]))).sum()),
        landed=last == str(Phase.DISARMED) and bool(columns["touched_down"][-1]),
        disarmed=not bool(columns["armed"][-1]),
        arms=_summarise_arms(columns, tracking) if "arm_phase" in columns else None,
        link=_summarise_link(columns, tracking) if "link_messages" in columns else None,
    )


def _summarise_arms(columns: Columns, tracking: NDArray[np.bool_]) -> ArmSummary:
    off_rad = np.abs(_floats(columns["joint_position_rad"]) - _floats(columns["joint_goal_rad"]))[tracking]
    known = off_rad[np.isfinite(off_rad).all(axis=1)]
    bad = _floats(columns["arm_bad_packets"])[tracking]
    return ArmSummary(
        float((columns["arm_phase"][tracking] == str(ArmPhase.MOVING)).mean()),
        float(known.max()) if known.size else float("nan"),
        spread_ms(_floats(columns["arm_bus_cycle_s"])[tracking]),
        int(bad[-1] - bad[0]),
    )


def _summarise_link(columns: Columns, tracking: NDArray[np.bool_]) -> LinkSummary:
    time_s = _floats(columns["time_s"])[tracking]
    passed_s = max(float(time_s[-1] - time_s[0]), 1e-9)

    def grown(name: str) -> int:
        return grown_by(columns, f"link_{name}", tracking)

    ages_s = message_ages_s(columns, tracking)
    return LinkSummary(
        uplink_bytes_per_s=grown("bytes") / passed_s,
        downlink_bytes_per_s=grown("bytes_down") / passed_s,
        messages_per_s=grown("messages") / passed_s,
        events=grown("events"),
        beats=grown("beats"),
        again=grown("again"),
        lost=grown("lost"),
        age_ms=spread_ms(ages_s[np.isfinite(ages_s)]),
        longest_silence_ms=1e3 * float(_floats(columns["link_silence_s"])[tracking].max()),
    )


def grown_by(columns: Columns, name: str, among: NDArray[np.bool_]) -> int:
    """Return by how much a count has grown; another session begins again from 0, and only between two flights."""
    counts = _floats(columns[name])[among]
    steps = np.diff(counts[np.isfinite(counts)])
    return int(steps[steps > 0.0].sum() + steps[(steps < 0.0) & (steps > -10.0)].sum())


def message_ages_s(columns: Columns, among: NDArray[np.bool_]) -> Array:
    """Return the age (s) at its arrival of each message that was the newest in one of these cycles; NaN if unknown."""
    arrived_s = _floats(columns["link_message_arrived_s"])[among]
    first = np.diff(arrived_s, prepend=np.nan) != 0.0
    return np.asarray((arrived_s - _floats(columns["link_message_sent_s"])[among])[first])


def tracking_error_w_m(columns: Columns) -> Array:
    """Return the estimated position, extrapolated to the instant of the cycle, minus the reference, (n, 3) in W, m."""
    carried = _floats(columns["age_s"])[:, None] * _floats(columns["velocity_w_mps"])
    return np.asarray(_floats(columns["position_w_m"]) + carried - _floats(columns["reference_position_w_m"]))


def spread_ms(values_s: Array) -> Spread:
    """Return median and 99th percentile in ms; NaN for no values."""
    if values_s.size == 0:
        return Spread(float("nan"), float("nan"))
    median, p99 = np.percentile(values_s, [50.0, 99.0]) * 1e3
    return Spread(float(median), float(p99))


def _floats(column: NDArray[np.generic]) -> Array:
    return np.asarray(column, dtype=np.float64)


def _triple(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
