"""Runs of the service that are heard on the bus: which one is spoken with, and how old what it says is."""

from dataclasses import dataclass

from companion.protocol.telemetry import Presence, State

SILENT_S = 1.0
"""States come ten times a second: a run that says none for so long is gone, hangs, or is cut off."""
_BACKLOG = 0.5
"""States that come in less than this share of the time between them were waiting somewhere."""
_LAG_S = (1.0, 60.0)
"""A state that is older than this by this computer's clock has waited, or the clocks differ; above it, they differ."""


@dataclass
class Run:
    """One run of the service. Times are of this computer's monotonic clock, s, unless said otherwise."""

    session: str
    presence: Presence | None = None
    state: State | None = None
    heard_s: float = float("-inf")
    """When its newest state came."""
    offset_s: float = float("inf")
    """The least that a state's arrival was behind the service's clock: of the state that waited least."""
    lag_s: float = 0.0
    """Age of the newest state at its arrival by this computer's wall clock, which may differ from the service's."""
    backlog: bool = True
    """The newest state came sooner after the one before than it was said; so it is taken to be before there are two."""

    def note(self, state: State, now_s: float, wall_s: float) -> None:
        """Take a state that has just come; `wall_s` is Unix time."""
        if self.state is not None:
            self.backlog = now_s - self.heard_s < _BACKLOG * (state.time_s - self.state.time_s)
        self.state, self.heard_s = state, now_s
        self.offset_s = min(self.offset_s, now_s - state.time_s)
        self.lag_s = wall_s - state.time_s

    def lives(self, now_s: float) -> bool:
        """Return whether its states come."""
        return now_s - self.heard_s < SILENT_S

    def age_s(self, now_s: float) -> float:
        """Return how old its newest state is: since it came, and what it waited longer than the quickest one."""
        return float("inf") if self.state is None else now_s - self.offset_s - self.state.time_s

    def service_time_s(self, now_s: float) -> float:
        """Return the time on the service's clock, Unix time."""
        return now_s - self.offset_s

    @property
    def waited_s(self) -> float:
        """What the newest state waited on its way if the two computers' clocks agree; 0 where they cannot."""
        return self.lag_s if _LAG_S[0] < self.lag_s < _LAG_S[1] else 0.0

    @property
    def caught_up(self) -> bool:
        """Whether the newest state is probably the newest there is."""
        return not (self.waited_s and self.backlog)


class Runs:
    """All of one vehicle's. One is followed: the first that is heard, until it falls silent and another is heard."""

    def __init__(self) -> None:
        self._runs: dict[str, Run] = {}
        self.followed: Run | None = None

    def note_presence(self, presence: Presence) -> None:
        """Take what may also be retained, and from whomever: it shows who may be there, and never who is not."""
        self._run(presence.session).presence = presence

    def note_state(self, state: State, now_s: float, wall_s: float) -> bool:
        """Take a state; return whether it is of the run that is followed."""
        run = self._run(state.session)
        run.note(state, now_s, wall_s)
        if self.followed is None or not (self.followed is run or self.followed.lives(now_s)):
            self.followed = run
        return self.followed is run

    def replaced(self, session: str, now_s: float) -> bool:
        """Return whether another run lives and this one does not: a retained status alone proves nothing."""
        mine = self._run(session)
        return not mine.lives(now_s) and any(run.lives(now_s) for run in self._runs.values() if run is not mine)

    @property
    def newest_presence(self) -> Presence | None:
        """Of the run that is followed, or else the newest."""
        if self.followed is not None and self.followed.presence is not None:
            return self.followed.presence
        known = [run.presence for run in self._runs.values() if run.presence is not None]
        return known[-1] if known else None

    def _run(self, session: str) -> Run:
        """Return it, as the newest."""
        run = self._runs.pop(session, None) or Run(session)
        self._runs[session] = run
        if len(self._runs) > _MOST_RUNS:
            del self._runs[next(name for name, one in self._runs.items() if one is not self.followed)]
        return run


_MOST_RUNS = 32
"""Anybody may publish a status with a session of its own."""
