"""The panel of `companion status` and the lines of `companion watch`: each says what it is of, and how old."""

import io
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from companion.cli.operator.output_formats import words_of
from companion.cli.operator.panel import panel
from companion.protocol.telemetry import Doing, Happened, Kind, LawLink, Presence, State

STATE = State(time_s=0.0, session="a", phase="hold", armed=True, in_air=True, mode="OFFBOARD")


def shown(state: State = STATE, **of_console: Any) -> str:
    """The panel's text, in lines that are not broken."""
    known: dict[str, Any] = {
        "state": state,
        "presence": Presence(online=True, session="a"),
        "linked": True,
        "where": "'vehicle'",
        "state_age_s": lambda: 0.1,
        "state_waited_s": lambda: 0.0,
    }
    out = Console(file=io.StringIO(), width=200)
    console: Any = SimpleNamespace(**(known | of_console))
    out.print(panel(console))
    assert isinstance(out.file, io.StringIO)
    return "\n".join(" ".join(line.split()) for line in out.file.getvalue().splitlines())


def test_px4s_mode_is_not_taken_for_the_vehicles_state() -> None:
    standing = STATE.model_copy(update={"phase": "standby", "armed": False, "in_air": False, "mode": "hold"})
    assert "vehicle disarmed, on the ground\nPX4 mode hold" in shown(standing)


@pytest.mark.parametrize(
    ("verb", "line"),
    [
        ("goto", "phase hold, on the way\n"),
        ("track", "phase hold, on the way to the start\n"),
        ("arms", "phase hold\n"),
    ],
)
def test_a_vehicle_on_its_way_does_not_just_hold(verb: str, line: str) -> None:
    assert line in shown(STATE.model_copy(update={"doing": Doing(id="1", verb=verb)}))


def test_a_vehicle_that_somebody_else_armed_is_not_disarmed() -> None:
    assert "the autopilot is armed, although the service flies nothing" in shown(
        STATE.model_copy(update={"phase": "disarmed"})
    )


def test_the_autopilots_words_and_what_is_wrong_beside_the_vehicle_are_shown() -> None:
    said = shown(STATE.model_copy(update={"text": "denied", "text_age_s": 42.0, "warnings": ("not recorded",)}))
    assert "autopilot denied (42 s ago)" in said
    assert "warning not recorded" in said


def test_how_old_a_state_is_is_said_for_what_it_is() -> None:
    gone = Presence(online=False, session="a")
    assert " s " not in shown()
    assert "this is 4.0 s old: the network or the broker is slow, or the two" in shown(state_waited_s=lambda: 4.0)
    assert "nothing heard for 3 s" in shown(state_age_s=lambda: 3.0)
    assert "no connection to the broker for 3 s" in shown(state_age_s=lambda: 3.0, linked=False)
    assert "the service does not run; last heard 3 s ago" in shown(state_age_s=lambda: 3.0, presence=gone)
    assert "does not run" not in shown(presence=gone), "its states come: somebody else said that it is gone"


@pytest.mark.parametrize(
    ("happened", "words"),
    [
        (Happened(time_s=0.0, kind=Kind.COMMAND, text="height_m=1.0", name="takeoff"), "command takeoff: height_m=1.0"),
        (Happened(time_s=0.0, kind=Kind.REPLY, text="", name="takeoff accepted"), "reply takeoff accepted"),
        (Happened(time_s=0.0, kind=Kind.PHASE, text="takeoff", name="takeoff"), "phase takeoff"),
        (Happened(time_s=0.0, kind=Kind.LOG, text="the flight is not recorded"), "the flight is not recorded"),
    ],
)
def test_a_command_a_reply_and_a_phase_look_different(happened: Happened, words: str) -> None:
    assert words_of(happened) == words


@pytest.mark.parametrize(
    ("link", "lines"),
    [
        (
            LawLink(connected=True, host="ws (process 4)", silence_s=0.012, age_s=0.002, received=30, missing=3),
            "ground law ws (process 4)\n"
            "its link silent for 12.0 ms, commands' age 2.0 ms, round trip not known, 33 messages/s, 3 lost, 0 late",
        ),
        (LawLink(connected=True, host="ws (process 4)", blind=True), "ground law ws (process 4), without a fresh pose"),
        (LawLink(connected=True, host="ws (process 4)", failed=True), "ground law ws (process 4), its law has failed"),
        (LawLink(connected=True, host="ws (process 4)", foreign=7), "0 late, 7 foreign"),
        (LawLink(connected=False), "ground law none"),
        (LawLink(connected=False, refused="install the same"), "ground law none; refused: install the same"),
    ],
)
def test_a_law_on_the_ground_is_shown_with_its_link(link: LawLink, lines: str) -> None:
    assert lines in shown(STATE.model_copy(update={"law_link": link}))


def test_a_law_on_board_has_no_lines_of_a_link() -> None:
    assert "link" not in shown()


def test_an_old_pose_is_said_to_be_old() -> None:
    here = STATE.model_copy(update={"position_w_m": (1.0, 2.0, 3.0), "age_s": 0.02})
    assert " s old" not in shown(here)
    assert "+3.00 m, 9.2 s old" in shown(here.model_copy(update={"age_s": 9.17}))
