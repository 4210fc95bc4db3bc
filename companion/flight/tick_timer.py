"""Timing of the next control cycle: started by a mocap frame, or by a deadline when none comes. Pure."""

from dataclasses import dataclass


def control_step_s(passed_s: float, period_s: float) -> float:
    """Return the step (s) of law and corrections for the time since the last cycle: 0.2 to 5 control periods."""
    return min(max(passed_s, 0.2 * period_s), 5.0 * period_s)


@dataclass
class TickTimer:
    """Keeps the control rate without drift and in step with the frames.

    The due time moves on by exactly one period a cycle, and is drawn gently towards the frames, so that a mocap clock
    that runs a little differently from ours does not beat against the deadline.
    """

    period_s: float
    due_s: float
    grace: float = 0.4
    """Share of a period that a late frame is waited for."""
    pull: float = 0.1
    """Share of the frame's offset that the due time takes over."""

    @property
    def deadline_s(self) -> float:
        """Begin the cycle now at the latest, frame or not."""
        return self.due_s + self.grace * self.period_s

    def frame_is_early(self, arrived_s: float) -> bool:
        """A frame that belongs to no cycle: the source is faster than the control loop."""
        return arrived_s < self.due_s - 0.5 * self.period_s

    def begin(self, now_s: float, frame_arrived_s: float | None) -> float:
        """Note that a cycle begins; returns how late it is (s), against its frame or the deadline, whichever was first.

        A loop that is behind finds a fresh frame every time: by that alone it would never be late.
        """
        begin_s = self.deadline_s
        if frame_arrived_s is not None:
            begin_s = min(begin_s, frame_arrived_s)
            half = 0.5 * self.period_s
            self.due_s += self.pull * min(max(frame_arrived_s - self.due_s, -half), half)
        self.due_s += self.period_s
        self.due_s += int(max(0.0, now_s - self.due_s) / self.period_s) * self.period_s
        return now_s - begin_s
