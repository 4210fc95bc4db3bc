"""Runs of the service seen on the bus: the one to follow, and the age of its states."""

from dataclasses import dataclass

from companion.protocol.telemetry import Presence, State

SILENT_S = 1.0
"""Time without a state (they come ten times a second) after which a run has ended, hangs, or is cut off."""
_BACKLOG = 0.5
"""Share of their spacing in time below which arriving states must have been queued."""
_LAG_S = (1.0, 60.0)
"""Age by this computer's clock from which a state may have been queued, and from which the clocks must differ."""


@dataclass(kw_only=True)
class Run:
    """One run of the service. Times are of this computer's monotonic clock, s, unless said otherwise."""

    session: str
    presence: Presence | None = None
    state: State | None = None
    heard_s: float = float("-inf")
    """Arrival of its newest state."""
    offset_s: float = float("inf")
    """Least difference between a state's arrival and its time stamp: that of the state with the least delay."""
    lag_s: float = 0.0
    """Age of the newest state at its arrival by this computer's wall clock, which may differ from the service's."""
    backlog: bool = True
    """True when the newest state arrived sooner after the last one than it was sent, and before there are two."""

    def note(self, state: State, now_s: float, wall_s: float) -> None:
        """Take a state that has just arrived; `wall_s` is Unix time."""
        if self.state is not None:
            self.backlog = now_s - self.heard_s < _BACKLOG * (state.time_s - self.state.time_s)
        self.state, self.heard_s = state, now_s
        self.offset_s = min(self.offset_s, now_s - state.time_s)
        self.lag_s = wall_s - state.time_s

    def lives(self, now_s: float) -> bool:
        """Return whether states of this run still arrive."""
        return now_s - self.heard_s < SILENT_S

    def age_s(self, now_s: float) -> float:
        """Return the age of its newest state, s: since arrival, plus its delay beyond that of the fastest one."""
        return float("inf") if self.state is None else now_s - self.offset_s - self.state.time_s

    def service_time_s(self, now_s: float) -> float:
        """Return the time on the service's clock, Unix time."""
        return now_s - self.offset_s

    @property
    def waited_s(self) -> float:
        """Time the newest state was queued on its way, s, if the clocks agree; 0 where they cannot."""
        return self.lag_s if _LAG_S[0] < self.lag_s < _LAG_S[1] else 0.0

    @property
    def caught_up(self) -> bool:
        """True when the newest state is probably the newest one that was sent."""
        return not (self.waited_s and self.backlog)


class Runs:
    """Runs of one vehicle's service; the first is followed until it falls silent and another one is seen."""

    def __init__(self) -> None:
        self._runs: dict[str, Run] = {}
        self.followed: Run | None = None

    def note_presence(self, presence: Presence) -> None:
        """Take a presence, possibly a retained one: it shows that a run may exist, never that one does not."""
        self._run(presence.session).presence = presence

    def note_state(self, state: State, now_s: float, wall_s: float) -> bool:
        """Take a state; return whether it belongs to the followed run."""
        run = self._run(state.session)
        run.note(state, now_s, wall_s)
        if self.followed is None or not (self.followed is run or self.followed.lives(now_s)):
            self.followed = run
        return self.followed is run

    def replaced(self, session: str, now_s: float) -> bool:
        """Return whether another run is alive and this one is not; a retained status alone proves nothing."""
        mine = self._run(session)
        return not mine.lives(now_s) and any(run.lives(now_s) for run in self._runs.values() if run is not mine)

    @property
    def newest_presence(self) -> Presence | None:
        """Presence of the followed run, or else the newest one."""
        if self.followed is not None and self.followed.presence is not None:
            return self.followed.presence
        known = [run.presence for run in self._runs.values() if run.presence is not None]
        return known[-1] if known else None

    def _run(self, session: str) -> Run:
        """Return the run with this session and make it the newest."""
        run = self._runs.pop(session, None) or Run(session=session)
        self._runs[session] = run
        if len(self._runs) > _MOST_RUNS:
            del self._runs[next(name for name, one in self._runs.items() if one is not self.followed)]
        return run


_MOST_RUNS = 32
"""Limit on remembered runs, as anybody may publish a status with any session."""
