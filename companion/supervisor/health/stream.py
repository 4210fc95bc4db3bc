"""Health checks of the frame stream: rate, delay, order, clock. Pure.

A network that stalls and then delivers all frames at once is no clock jump, and a lasting delay must stay visible,
although the estimator's clock comparison adapts to it.
"""

from dataclasses import field, replace
from math import inf, isfinite, nan

from companion.core.values import value
from companion.estimation.state import Verdict
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD, Window
from companion.supervisor.health.mocap import USABLE, relied_on
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules

WINDOW_S = 1.0
"""Window over which frames are counted."""
DELAY_WINDOW_S = 0.5
"""Window over which delays are compared with the limit."""
OFF_FRAMES = 3
"""Consecutive frames off the clock that make a new clock; fewer are broken or late frames."""
DRIFT = 1e-4
"""Largest drift of two clocks, s/s: crystals drift less, so that a lasting delay stays visible for minutes."""


@value(kw_only=True)
class StampClock:
    """Motion capture's clock against ours, as of the last frame that fits it."""

    frame: int = -1
    stamp_s: float = nan
    latency_s: float = nan
    """Arrival less stamp: the latency plus an unknown constant."""
    period_s: float = nan
    """Time between two frame numbers, by the stamps."""
    off: int = 0
    """Consecutive frames that do not fit it."""
    least_s: float = inf
    """Smallest latency, corrected for drift."""
    at_s: float = nan
    """Time of the last frame that fits it."""
    jump: str = ""
    """Message of a clock jump while poses were relied on; empty without one."""


@value(kw_only=True)
class StreamHealth:
    """Memory of the stream checks."""

    begun_s: float = NOT_HELD
    """Begin of the unbroken stream of usable frames."""
    frames: Window = field(default_factory=Window)
    """Frames of the last second, 1 for a usable one."""
    stale: Window = field(default_factory=Window)
    """Frames of the last second older than one already used."""
    dropped: Window = field(default_factory=Window)
    """Numbers of such frames dropped by the source, in the last second."""
    late: int = 0
    """Number of frames dropped by the source in total."""
    late_cycles: Window = field(default_factory=Window)
    """Delays (s) of those cycles of the last second that may have skipped a frame."""
    delayed: Window = field(default_factory=Window)
    """Usable frames of the last half second that were too late, with their delay (s)."""
    clock: StampClock = field(default_factory=StampClock)


def check_stream(
    memory: StreamHealth, now: HealthInputs, rules: SafetyRules, new: bool
) -> tuple[StreamHealth, list[Event]]:
    """Check the frame stream; `new`: this cycle has a new frame. No events unless poses are `relied_on`."""
    memory = _update(memory, now, rules, new)
    if not relied_on(now):
        return memory, []
    events = []
    if memory.clock.jump:
        events.append(Event(Fault.MOCAP_CLOCK_JUMP, memory.clock.jump))
    streaming_s = now.time_s - memory.begun_s
    if streaming_s >= DELAY_WINDOW_S and memory.delayed.times_s:
        events += _delay_events(memory, now.time_s, rules)
    if streaming_s >= WINDOW_S:
        events += _count_events(memory, rules)
    return memory, events


def _update(memory: StreamHealth, now: HealthInputs, rules: SafetyRules, new: bool) -> StreamHealth:
    time_s, mocap = now.time_s, now.mocap
    begun_s = memory.begun_s if mocap.age_s <= rules.silent_s else NOT_HELD
    frames = memory.frames.kept(time_s - WINDOW_S)
    stale = memory.stale.kept(time_s - WINDOW_S)
    dropped = memory.dropped.kept(time_s - WINDOW_S)
    late_cycles = memory.late_cycles.kept(time_s - WINDOW_S)
    if isfinite(now.late_s) and now.late_s > 0.5 / rules.slow_hz:
        late_cycles = late_cycles.added(time_s, now.late_s)
    delayed = memory.delayed.kept(time_s - DELAY_WINDOW_S)
    clock = memory.clock
    if clock.jump and not relied_on(now):
        clock = replace(clock, jump="")
    if new:
        clock = _update_clock(clock, now, rules)
        if mocap.late > memory.late:
            dropped = dropped.added(time_s, float(mocap.late - memory.late))
        usable = mocap.verdict in USABLE
        frames = frames.added(time_s, float(usable))
        if usable:
            begun_s = min(begun_s, time_s) if mocap.age_s <= rules.silent_s else NOT_HELD
            grown_s = clock.latency_s - clock.least_s if not clock.off else 0.0
            delay_s = max(mocap.age_s, grown_s)
            if delay_s > rules.delayed_s:
                delayed = delayed.added(time_s, delay_s)
        elif mocap.verdict is Verdict.STALE:
            stale = stale.added(time_s, 1.0)
    return StreamHealth(
        begun_s=begun_s,
        frames=frames,
        stale=stale,
        dropped=dropped,
        late=mocap.late,
        late_cycles=late_cycles,
        delayed=delayed,
        clock=clock,
    )


def _update_clock(clock: StampClock, now: HealthInputs, rules: SafetyRules) -> StampClock:
    """Update the clock with a frame; a stamp that fits neither its arrival nor its frame number is off the clock."""
    mocap = now.mocap
    latency_s = mocap.received_s - mocap.stamp_s
    step_s = latency_s - clock.latency_s
    newest = StampClock(
        frame=mocap.frame, stamp_s=mocap.stamp_s, latency_s=latency_s, least_s=latency_s, at_s=now.time_s
    )
    if not abs(step_s) > rules.clock_jump_s or _stamp_follows_number(clock, mocap, rules):
        frames = mocap.frame - clock.frame
        period_s = (mocap.stamp_s - clock.stamp_s) / frames if frames > 0 else clock.period_s
        drifted_s = clock.least_s + DRIFT * (now.time_s - clock.at_s)
        least_s = drifted_s if latency_s >= drifted_s else latency_s
        return replace(newest, period_s=period_s, least_s=least_s, jump=clock.jump)
    if clock.off + 1 < OFF_FRAMES:
        return replace(clock, off=clock.off + 1)
    jump = f"motion capture's stamps jumped by {-step_s:+.2f} s against their arrival" if relied_on(now) else ""
    return replace(newest, jump=jump)


def _stamp_follows_number(clock: StampClock, mocap: MocapInputs, rules: SafetyRules) -> bool:
    """Return true if the stamp advanced with the frame number: then only the arrival was early or late."""
    frames = mocap.frame - clock.frame
    off_s = mocap.stamp_s - clock.stamp_s - frames * clock.period_s
    return frames > 0 and abs(off_s) <= rules.clock_jump_s


def _delay_events(memory: StreamHealth, now_s: float, rules: SafetyRules) -> list[Event]:
    """Return an event if the median delay is above the limit: more than half of the frames are."""
    usable = int(memory.frames.kept(now_s - DELAY_WINDOW_S).total)
    delays_s = sorted(memory.delayed.numbers)
    if 2 * len(delays_s) <= usable:
        return []
    middle_s = delays_s[(usable - 1) // 2 - (usable - len(delays_s))]
    text = f"poses come {middle_s:.3f} s late for {DELAY_WINDOW_S:g} s, more than {rules.delayed_s:g} s"
    return [Event(Fault.MOCAP_DELAYED, text)]


def _slow_event(usable: float, late_cycles_s: float, rules: SafetyRules) -> Event:
    """Return a slow-mocap event, or a late-loop event if late cycles explain the missing frames."""
    text = f"{usable:.0f} usable frames in a second, fewer than {rules.slow_hz:g}"
    if usable < rules.slow_hz * (1.0 - late_cycles_s / WINDOW_S):
        return Event(Fault.MOCAP_SLOW, text)
    return Event(Fault.LOOP_LATE, f"{text}: cycles began {late_cycles_s:.2f} s late in it")


def _count_events(memory: StreamHealth, rules: SafetyRules) -> list[Event]:
    events = []
    usable, dropped = memory.frames.total, memory.dropped.total
    frames, stale = len(memory.frames.times_s) + dropped, len(memory.stale.times_s) + dropped
    if usable < rules.slow_hz:
        events.append(_slow_event(usable, memory.late_cycles.total, rules))
    if stale > rules.out_of_order_share * frames:
        text = f"{stale:.0f} of {frames:.0f} frames in a second are older than one already used"
        events.append(Event(Fault.MOCAP_OUT_OF_ORDER, text))
    return events
