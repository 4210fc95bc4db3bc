"""Session with a vehicle, on the ground, and its state for observers. Pure."""

from dataclasses import dataclass, field
from math import inf, nan

from companion.law_link.clock_offset import ClockOffset, RoundTrip
from companion.law_link.messages import TICK_S, Command, Plan, Report, seconds_between, ticks_of
from companion.law_link.sealing import SessionKeys
from companion.law_link.sequence_window import SequenceWindow


@dataclass(kw_only=True)
class LinkCounts:
    """Messages and payload bytes of a session so far, tags included."""

    events: int = 0
    again: int = 0
    beats: int = 0
    bytes_up: int = 0
    bytes_down: int = 0
    reports: int = 0

    @property
    def messages(self) -> int:
        """Messages up."""
        return self.events + self.again + self.beats


@dataclass(frozen=True, kw_only=True)
class GroundLinkState:
    """Link as the ground sees it."""

    session: int
    """0 before the first session."""
    number: int
    """Number of the newest command."""
    acknowledged: int
    """Number of the command that the vehicle has in use; 0 without one."""
    phase: int | None
    """Phase of the flight as the vehicle has reported last, by its place in `Phase`; None before the first report."""
    silence_s: float
    """Time since the newest report; infinite before the first."""
    clock_offset_s: float
    """Vehicle's clock less the ground's; NaN before the first report."""
    round_trip_s: float
    """Quickest round trip of the last seconds."""
    up_age_s: float
    """Median age of the messages up when the vehicle uses them; NaN while unknown."""
    counts: LinkCounts


@dataclass(kw_only=True)
class GroundSession:
    """Session with the vehicle."""

    number: int
    keys: SessionKeys
    window: SequenceWindow = field(default_factory=SequenceWindow)
    sent: int = 0
    sent_s: float = -inf
    clock_s: float = -inf
    """Time at which the vehicle was told the clocks' offset."""
    clock_told_s: float = nan
    """Offset that it was told."""
    clock: ClockOffset = field(default_factory=ClockOffset)
    report: Report | None = None
    report_s: float = -inf
    plan: Plan | None = None
    plan_sequence: int = 0
    command: Command | None = None
    number_sent: int = 0
    command_s: float = -inf
    """Time at which the newest command was first sent."""
    again_s: float = -inf
    """Time at which it was last sent."""

    def take_report(self, report: Report, now_s: float) -> None:
        """Take the newest report, which also compares the clocks."""
        self.report, self.report_s = report, now_s
        self.clock = self.clock.after(_round_trip(report, now_s))

    def take_plan(self, plan: Plan) -> None:
        """Take a plan unless it is older than the one known."""
        if plan.knots and plan.sequence > self.plan_sequence:
            self.plan, self.plan_sequence = plan, plan.sequence


def _round_trip(report: Report, now_s: float) -> RoundTrip:
    """Return the exchange that a report ends; times count from now on our clock, and from the report's stamp there."""
    sent_s = now_s - seconds_between(ticks_of(now_s), report.echo)
    vehicle_s = now_s + seconds_between(report.stamp, ticks_of(now_s))
    return RoundTrip(
        ground_sent_s=sent_s,
        vehicle_received_s=vehicle_s - report.held * TICK_S,
        vehicle_sent_s=vehicle_s,
        ground_received_s=now_s,
    )
