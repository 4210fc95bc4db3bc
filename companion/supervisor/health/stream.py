"""How good the stream of usable frames is: rate, delay, order, clock. Pure.

A network that stalls and then delivers all at once must not be taken for a clock that jumped, and a delay that stays
must not be forgotten as the estimator's clock comparison forgets it.
"""

from dataclasses import field, replace
from math import inf, isfinite, nan

from companion.core.values import value
from companion.estimation.state import Verdict
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NEVER, Window
from companion.supervisor.health.mocap import USABLE, relied_on
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules

WINDOW_S = 1.0
"""Over which frames are counted."""
DELAY_WINDOW_S = 0.5
"""Over which delays are judged."""
OFF_FRAMES = 3
"""So many frames in a row off the known clock are a new clock; fewer are broken or late frames."""
DRIFT = 1e-4
"""How fast two clocks may part, s/s: crystals do less, so that a delay that stays shows for minutes."""


@value
class StampClock:
    """Motion capture's clock against ours, as of the last frame that fits it."""

    frame: int = -1
    stamp_s: float = nan
    latency_s: float = nan
    """Arrival less stamp: the latency plus an unknown constant."""
    period_s: float = nan
    """From one frame number to the next, by the stamps."""
    off: int = 0
    """Frames in a row that do not fit it."""
    least_s: float = inf
    """Least latency, apart from drift."""
    at_s: float = nan
    """When a frame last fitted."""
    jump: str = ""
    """How it jumped while poses were relied on."""


@value
class StreamHealth:
    """What is remembered."""

    begun_s: float = NEVER
    """Since when usable frames come without a silence."""
    frames: Window = field(default_factory=Window)
    """Frames of the last second, 1 for a usable one."""
    stale: Window = field(default_factory=Window)
    """Those older than one already used."""
    dropped: Window = field(default_factory=Window)
    """How many such frames were dropped on their way here, in the last second."""
    late: int = 0
    """How many in all."""
    overslept: Window = field(default_factory=Window)
    """How late (s) those cycles of the last second began that may have passed over a frame."""
    delayed: Window = field(default_factory=Window)
    """Usable ones of the last half second that came too late, with their delay (s)."""
    clock: StampClock = field(default_factory=StampClock)


def look_at_stream(
    memory: StreamHealth, now: HealthInputs, rules: SafetyRules, new: bool
) -> tuple[StreamHealth, list[Event]]:
    """`new`: this cycle brought a frame. Nothing is said unless poses are `relied_on`."""
    memory = _moved_on(memory, now, rules, new)
    if not relied_on(now):
        return memory, []
    events = []
    if memory.clock.jump:
        events.append(Event(Fault.MOCAP_CLOCK_JUMP, memory.clock.jump))
    known_s = now.time_s - memory.begun_s
    if known_s >= DELAY_WINDOW_S and memory.delayed.times_s:
        events += _of_delay(memory, now.time_s, rules)
    if known_s >= WINDOW_S:
        events += _of_count(memory, rules)
    return memory, events


def _moved_on(memory: StreamHealth, now: HealthInputs, rules: SafetyRules, new: bool) -> StreamHealth:
    time_s, seen = now.time_s, now.seen
    begun_s = memory.begun_s if seen.age_s <= rules.silent_s else NEVER
    frames = memory.frames.kept(time_s - WINDOW_S)
    stale = memory.stale.kept(time_s - WINDOW_S)
    dropped = memory.dropped.kept(time_s - WINDOW_S)
    overslept = memory.overslept.kept(time_s - WINDOW_S)
    if isfinite(now.late_s) and now.late_s > 0.5 / rules.slow_hz:
        overslept = overslept.added(time_s, now.late_s)
    delayed = memory.delayed.kept(time_s - DELAY_WINDOW_S)
    clock = memory.clock
    if clock.jump and not relied_on(now):
        clock = replace(clock, jump="")
    if new:
        clock = _observed(clock, now, rules)
        if seen.late > memory.late:
            dropped = dropped.added(time_s, float(seen.late - memory.late))
        usable = seen.verdict in USABLE
        frames = frames.added(time_s, float(usable))
        if usable:
            begun_s = min(begun_s, time_s) if seen.age_s <= rules.silent_s else NEVER
            grown_s = clock.latency_s - clock.least_s if not clock.off else 0.0
            delay_s = max(seen.age_s, grown_s)
            if delay_s > rules.delayed_s:
                delayed = delayed.added(time_s, delay_s)
        elif seen.verdict is Verdict.STALE:
            stale = stale.added(time_s, 1.0)
    return StreamHealth(begun_s, frames, stale, dropped, seen.late, overslept, delayed, clock)


def _observed(clock: StampClock, now: HealthInputs, rules: SafetyRules) -> StampClock:
    """One frame more. A stamp off both its arrival and its frame number is off the clock."""
    seen = now.seen
    latency_s = seen.received_s - seen.stamp_s
    step_s = latency_s - clock.latency_s
    if not abs(step_s) > rules.clock_jump_s or _counted_on(clock, seen, rules):
        frames = seen.frame - clock.frame
        period_s = (seen.stamp_s - clock.stamp_s) / frames if frames > 0 else clock.period_s
        drifted_s = clock.least_s + DRIFT * (now.time_s - clock.at_s)
        least_s = drifted_s if latency_s >= drifted_s else latency_s
        return StampClock(seen.frame, seen.stamp_s, latency_s, period_s, 0, least_s, now.time_s, clock.jump)
    if clock.off + 1 < OFF_FRAMES:
        return replace(clock, off=clock.off + 1)
    jump = f"motion capture's stamps jumped by {-step_s:+.2f} s against their arrival" if relied_on(now) else ""
    return StampClock(seen.frame, seen.stamp_s, latency_s, nan, 0, latency_s, now.time_s, jump)


def _counted_on(clock: StampClock, seen: MocapInputs, rules: SafetyRules) -> bool:
    """Whether the stamp went on with the frame number: then it is the arrival that was early or late."""
    frames = seen.frame - clock.frame
    off_s = seen.stamp_s - clock.stamp_s - frames * clock.period_s
    return frames > 0 and abs(off_s) <= rules.clock_jump_s


def _of_delay(memory: StreamHealth, now_s: float, rules: SafetyRules) -> list[Event]:
    """The median is above the limit when more than half are."""
    usable = int(memory.frames.kept(now_s - DELAY_WINDOW_S).total)
    delays_s = sorted(memory.delayed.numbers)
    if 2 * len(delays_s) <= usable:
        return []
    middle_s = delays_s[(usable - 1) // 2 - (usable - len(delays_s))]
    text = f"poses come {middle_s:.3f} s late for {DELAY_WINDOW_S:g} s, more than {rules.delayed_s:g} s"
    return [Event(Fault.MOCAP_DELAYED, text)]


def _of_slowness(usable: float, overslept_s: float, rules: SafetyRules) -> Event:
    """Whose fault it is: in the time that the loop was awake, enough frames may have come."""
    text = f"{usable:.0f} usable frames in a second, fewer than {rules.slow_hz:g}"
    if usable < rules.slow_hz * (1.0 - overslept_s / WINDOW_S):
        return Event(Fault.MOCAP_SLOW, text)
    return Event(Fault.LOOP_LATE, f"{text}: cycles began {overslept_s:.2f} s late in it")


def _of_count(memory: StreamHealth, rules: SafetyRules) -> list[Event]:
    events = []
    usable, dropped = memory.frames.total, memory.dropped.total
    frames, stale = len(memory.frames.times_s) + dropped, len(memory.stale.times_s) + dropped
    if usable < rules.slow_hz:
        events.append(_of_slowness(usable, memory.overslept.total, rules))
    if stale > rules.out_of_order_share * frames:
        text = f"{stale:.0f} of {frames:.0f} frames in a second are older than one already used"
        events.append(Event(Fault.MOCAP_OUT_OF_ORDER, text))
    return events
