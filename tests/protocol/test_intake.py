"""Validation of received commands, without a broker."""

import json
from typing import Any

import pytest

from companion.core.waypoint_limits import MAX_WAYPOINTS
from companion.protocol.commands import AT_ONCE, VERBS, Command
from companion.protocol.intake import MAX_BYTES, STALE_S, Intake, Refusal
from tests.protocol.payloads import GOOD, NOW_S, SESSION, payload


def refused(said: bytes) -> Refusal:
    taken = Intake(SESSION).take(said, NOW_S)
    assert isinstance(taken, Refusal)
    return taken


def taken(said: bytes) -> Command:
    read = Intake(SESSION).take(said, NOW_S + 0.1)
    assert not isinstance(read, Refusal), read
    return read


@pytest.mark.parametrize("verb", GOOD)
def test_a_good_command_is_taken_as_it_is(verb: str) -> None:
    read = taken(payload(verb))
    assert (read.verb, read.id) == (verb, "a-1")
    assert read.model_dump().items() >= GOOD[verb].items()


def test_every_verb_is_tried_here() -> None:
    assert set(GOOD) == set(VERBS)
    assert set(VERBS) > AT_ONCE


def test_kill_needs_its_confirmation_and_nothing_else_may_have_one() -> None:
    assert refused(payload("kill", confirm="yes")).reason.startswith("confirm: ")
    assert refused(payload("kill", confirm=True)).reason.startswith("confirm: ")
    assert refused(payload("abort", confirm="kill")).reason == "confirm: unknown key"


def test_an_id_counts_once_and_a_refused_one_not_at_all() -> None:
    intake = Intake(SESSION)
    assert isinstance(intake.take(payload("kill", confirm="no"), NOW_S), Refusal)
    assert not isinstance(intake.take(payload("kill"), NOW_S), Refusal)
    assert intake.take(payload("land", reply_to="me"), NOW_S) == Refusal("this id was taken already", "a-1", "me")


def test_no_id_is_forgotten_and_after_very_many_only_abort_and_kill_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.protocol.intake._MOST_IDS", 1000)
    intake = Intake(SESSION)
    for number in range(1000):
        assert not isinstance(intake.take(payload(id=f"n{number}"), NOW_S), Refusal)
    for number in (0, 500, 999):
        assert isinstance(intake.take(payload("abort", id=f"n{number}"), NOW_S), Refusal)
    assert isinstance(intake.take(payload("land", id="more"), NOW_S), Refusal)
    assert not isinstance(intake.take(payload("abort", id="more"), NOW_S), Refusal)
    assert not isinstance(intake.take(payload("kill", id="most"), NOW_S), Refusal)


@pytest.mark.parametrize("verb", GOOD)
@pytest.mark.parametrize(("late_s", "counts"), [(4.9, True), (5.1, False), (-4.9, True), (-5.1, False), (-1e9, False)])
def test_a_command_is_for_now(verb: str, late_s: float, counts: bool) -> None:
    read = Intake(SESSION).take(payload(verb, sent_s=NOW_S - late_s), NOW_S)
    assert isinstance(read, Refusal) is not counts
    if isinstance(read, Refusal):
        assert (read.id, f"{STALE_S:g} s count" in read.reason) == ("a-1", True)


def test_another_run_of_the_service_is_not_meant() -> None:
    assert "another run of the service" in refused(payload("kill", session="f" * 16)).reason


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"", "invalid JSON"),
        (b"abort", "invalid JSON"),
        (b"\xff\xfe\x00", "invalid JSON"),
        (b"[" * 40_000, "invalid JSON"),
        (b'{"a":' * 9_000, "invalid JSON"),
        (b'"abort"', "must be"),
        (payload("fly"), "verb: must be one of preflight, arm, "),
        (payload(verb=None), "verb: must be one of"),
        (payload(id=""), "id: must be 1 to 64 characters of A-Za-z0-9_.:-"),
        (payload(id="two\nlines"), "id: must be 1 to 64 characters of A-Za-z0-9_.:-"),
        (payload(id=7), "id: must be text in quotes"),
        (payload(session="F" * 16), "session: must be 16 characters of 0-9a-f"),
        (payload(sent_s="now"), "sent_s: must be a number"),
        (payload(sent_s=True), "sent_s: must be a number"),
        (payload(sent_s=float("nan")), "sent_s: must be a finite number"),
        (payload(sent_s=1e300), "sent_s: must be at most"),
        (payload(height_m=2.0), "height_m: unknown key"),
        (payload(reply_to="a/b"), "reply_to: must be 1 to 64 characters of"),
        (payload(reply_to="#"), "reply_to: must be 1 to 64 characters of"),
        (payload("takeoff", height_m=0.0), "height_m: must be above 0"),
        (payload("takeoff", height_m=1e9), "height_m: must be at most"),
        (payload("goto", z_m=-1.0), "z_m: must be above 0"),
        (payload("track", waypoints=[]), "waypoints: must have at least 2 values, it has"),
        (payload("track", waypoints=[{"t_s": 0.0}]), "waypoints.0.x_m: is missing"),
        (payload("track", curve=None), "give either curve or waypoints"),
        (payload("arms", motion=None), "play needs a motion"),
        (payload("controller", name="../etc/passwd"), "name: must be 1 to 64 characters of a-z0-9_-"),
        (payload(note="x" * MAX_BYTES), "bytes are no command: at most 48000"),
        (payload("hold", **{f"k{number}": 1 for number in range(4000)}), "4004 fields are no command: at most 32"),
        (b'{"id": "a-1", "sent_s": 1.0}', "verb: must be one of"),
    ],
)
def test_all_else_is_refused_with_a_short_reason(said: bytes, reason: str) -> None:
    assert reason in refused(said).reason
    assert len(refused(said).reason) <= 200


@pytest.mark.parametrize(
    ("changes", "name", "client"),
    [
        ({"verb": 7, "reply_to": "me"}, "a-1", "me"),
        ({"verb": 7, "id": 7, "reply_to": "me"}, "", "me"),
        ({"verb": 7, "id": "two\nlines", "reply_to": "a/b"}, "", None),
        ({"id": "a\n", "reply_to": "me\n"}, "", None),
        ({"verb": 7, "reply_to": ["me"]}, "a-1", None),
    ],
)
def test_a_refusal_says_whose_command_it_was_if_that_can_be_read(
    changes: dict[str, Any], name: str, client: str | None
) -> None:
    read = refused(payload(**changes))
    assert (read.id, read.reply_to) == (name, client)


def test_the_most_waypoints_there_may_be_fit() -> None:
    points = [{"t_s": number * 0.123456, "x_m": -1.23456, "y_m": 1.23456, "z_m": 1.23456, "yaw_rad": -1.23456}
              for number in range(MAX_WAYPOINTS)]  # fmt: skip
    said = json.loads(payload("track")) | {"curve": None, "waypoints": points}
    read = taken(json.dumps(said).encode())
    assert read.verb == "track"
    assert read.waypoints is not None
    assert len(read.waypoints) == MAX_WAYPOINTS


def test_thousands_of_mistakes_are_not_all_looked_for() -> None:
    """Each costs time in which nothing flies: 11000 of them 0.3 s."""
    many = refused(payload("track", curve=None, waypoints=[{}] * 11_000))
    assert many.reason == "waypoints.0.t_s: is missing"
