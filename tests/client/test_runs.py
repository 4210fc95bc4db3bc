"""Tests of the run of the service that is followed, and of the age of its states; no clock, no broker."""

import pytest

from companion.client.runs import Run, Runs
from companion.protocol.telemetry import Presence, State

CLOCKS_APART_S = 1000.0
"""Service's Unix time above this computer's monotonic time."""


def state(session: str, time_s: float) -> State:
    return State(time_s=CLOCKS_APART_S + time_s, session=session, phase="hold")


def heard(runs: Runs, session: str, at_s: float, said_s: float | None = None) -> bool:
    """A state that comes at `at_s` and was said at `said_s`, on one time scale; the wall clocks agree."""
    said = at_s if said_s is None else said_s
    return runs.note_state(state(session, said), at_s, CLOCKS_APART_S + at_s)


def test_the_first_run_is_followed_until_it_falls_silent() -> None:
    runs = Runs()
    assert heard(runs, "a", 0.0)
    assert not heard(runs, "b", 0.1), "a second service of the same name"
    assert not runs.replaced("a", 0.2)
    assert heard(runs, "b", 1.5), "now it is the service restarted"
    assert runs.replaced("a", 1.6)
    assert not runs.replaced("b", 1.6)


def test_a_status_alone_replaces_nobody() -> None:
    runs = Runs()
    heard(runs, "a", 0.0)
    for number in range(100):
        runs.note_presence(Presence(online=True, session=f"{number}"))
    assert not runs.replaced("a", 0.5)
    assert not runs.replaced("a", 5.0), "it is silent, and nobody else is heard"
    assert runs.followed is not None
    assert runs.followed.session == "a"
    assert runs.newest_presence is not None, "of those that say nothing else"


def test_a_state_that_waited_in_a_flooded_broker_is_old() -> None:
    runs = Runs()
    heard(runs, "a", 0.0)
    heard(runs, "a", 4.1, said_s=0.1)
    run = runs.followed
    assert run is not None
    assert run.age_s(4.2) == pytest.approx(4.1)
    assert run.service_time_s(4.2) == pytest.approx(CLOCKS_APART_S + 4.2), "a command is dated by the quickest state"


def test_the_first_state_after_a_flood_is_not_taken_for_the_newest() -> None:
    """Estimate the age for a client that has just connected, from this computer's clock and the next states."""
    run = Run(session="a")
    run.note(state("a", 0.0), 4.0, CLOCKS_APART_S + 4.0)
    assert run.waited_s == pytest.approx(4.0)
    assert not run.caught_up
    run.note(state("a", 0.1), 4.001, CLOCKS_APART_S + 4.001)
    assert not run.caught_up, "they come all at once"
    run.note(state("a", 3.999), 4.01, CLOCKS_APART_S + 4.01)
    assert (run.waited_s, run.caught_up) == (0.0, True)


def test_clocks_that_are_far_apart_or_behind_prove_nothing() -> None:
    for apart_s in (3600.0, -3600.0, -4.0):
        run = Run(session="a")
        run.note(state("a", 0.0), 0.0, CLOCKS_APART_S + apart_s)
        assert (run.waited_s, run.caught_up) == (0.0, True)


def test_clocks_that_differ_by_seconds_cost_one_more_state() -> None:
    run = Run(session="a")
    for at_s in (0.0, 0.1):
        run.note(state("a", at_s), at_s, CLOCKS_APART_S + at_s + 4.0)
    assert run.waited_s == pytest.approx(4.0)
    assert run.caught_up
