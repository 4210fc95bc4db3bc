"""Messages of a page: each once, in its form, and a kill in two of them."""

import json
from typing import Any

import pytest

from companion.page.page_commands import AFTER_S, UNTIL_S, NotAcceptedError, Order, PageCommands, Question
from companion.protocol.commands import VERBS
from tests.page.asgi import VEHICLES

ONE, OTHER = VEHICLES


def message(ref: int, verb: str = "hold", vehicle: str = ONE, **fields: Any) -> str:
    return json.dumps({"type": "command", "ref": ref, "vehicle": vehicle, "verb": verb, **fields})


def take(reader: PageCommands, text: str, now_s: float = 0.0, can_command: bool = True) -> Order | Question:
    return reader.take(text, VEHICLES, can_command, now_s)


def refusal(reader: PageCommands, text: str, now_s: float = 0.0, can_command: bool = True) -> str:
    with pytest.raises(NotAcceptedError) as caught:
        take(reader, text, now_s, can_command)
    return str(caught.value)


FIELDS: dict[str, dict[str, Any]] = {
    "goto": {"x_m": 0.5, "y_m": -0.5, "z_m": 1.2},
    "takeoff": {"height_m": 0.8},
    "track": {"curve": "ellipse", "laps": 1},
    "arms": {"do": "play", "motion": "swing"},
    "controller": {"name": "pid"},
}


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != "kill"])
def test_every_verb_becomes_its_command(verb: str) -> None:
    order = take(PageCommands(), message(1, verb, **FIELDS.get(verb, {})))
    assert isinstance(order, Order)
    assert (order.ref, order.vehicle, order.draft.verb) == (1, ONE, verb)
    assert json.loads(order.draft.payload("0" * 16, 1.0, "me")).items() >= FIELDS.get(verb, {}).items()


FORGED: dict[str, Any] = {"id": "mine", "session": "0" * 16, "sent_s": 1.0, "reply_to": "another", "waypoints": []}


@pytest.mark.parametrize("name", FORGED)
def test_what_the_server_adds_is_not_the_pages_to_give(name: str) -> None:
    value = FORGED[name]
    assert refusal(PageCommands(), message(1, **{name: value})) == f"{name}: a page does not give this"


def test_a_number_counts_once_and_only_upwards() -> None:
    reader = PageCommands()
    for ref in (1, 2, 5, 2**53 - 1):
        take(reader, message(ref))
    for ref in (1, 5, 6, 2**53 - 1):
        assert "this is a repetition" in refusal(reader, message(ref))


def test_a_message_that_is_refused_has_used_its_number() -> None:
    reader = PageCommands()
    assert refusal(reader, message(3, can_fly="yes"))
    assert "repetition" in refusal(reader, message(3))


@pytest.mark.parametrize("ref", [0, -1, 1.0, "1", True, None, 2**53, [1]])
def test_a_number_is_a_whole_one_from_one_on(ref: Any) -> None:
    assert refusal(PageCommands(), message(ref)).startswith("ref: must be a whole number")


@pytest.mark.parametrize(
    "text",
    ["", "null", "[]", "1", '"hold"', "{", "[" * 8000, '{"a":' * 1000, "\x00", '{"type":"command","ref":NaN}', "{}",
     '{"type":"state"}', json.dumps({str(n): n for n in range(40)})],
)  # fmt: skip
def test_what_is_no_command_is_refused(text: str) -> None:
    assert refusal(PageCommands(), text)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"verb": "explode"}, "verb: must be one of"),
        ({"verb": 7}, "verb: must be one of"),
        ({"vehicle": "stranger"}, "there is no vehicle of this name"),
        ({"vehicle": ["dauam-1"]}, "there is no vehicle of this name"),
        ({"verb": "goto", "x_m": 0.5}, "goto: y_m"),
        ({"verb": "goto", "x_m": 1e9, "y_m": 0.0, "z_m": 1.0}, "goto: x_m"),
        ({"verb": "goto", "x_m": "0", "y_m": 0.0, "z_m": 1.0}, "goto: x_m"),
        ({"nonce": "x"}, "only a kill has one"),
        ({"verb": "hold", "confirm": "kill"}, "hold: confirm"),
        ({"text": "\ud800"}, "not JSON"),
        ({"verb": "controller", "name": "../../etc/passwd"}, "controller: name"),
    ],
)
def test_a_command_is_refused_with_what_is_wrong(fields: dict[str, Any], words: str) -> None:
    said = refusal(PageCommands(), message(1) if not fields else json.dumps({**json.loads(message(1)), **fields}))
    assert words in said
    assert len(said) <= 200


def test_who_is_not_logged_in_commands_nothing() -> None:
    for verb in VERBS:
        assert "log in" in refusal(PageCommands(), message(1, verb, **FIELDS.get(verb, {})), can_command=False)


def test_more_than_eight_kilobytes_are_not_read() -> None:
    assert "at most 8192 bytes" in refusal(PageCommands(), message(1, text="x" * 8192))
    assert "at most 8192 bytes" in refusal(PageCommands(), message(1, text="ü" * 4096))


def asked(reader: PageCommands, ref: int = 1, now_s: float = 0.0, vehicle: str = ONE) -> str:
    question = take(reader, message(ref, "kill", vehicle), now_s)
    assert isinstance(question, Question)
    return question.nonce


def test_a_kill_is_asked_for_and_then_confirmed() -> None:
    reader = PageCommands()
    nonce = asked(reader)
    order = take(reader, message(2, "kill", confirm="kill", nonce=nonce), AFTER_S)
    assert isinstance(order, Order)
    assert (order.vehicle, order.draft.verb) == (ONE, "kill")
    assert "ask for it first" in refusal(reader, message(3, "kill", confirm="kill", nonce=nonce), AFTER_S), "once"


@pytest.mark.parametrize("extra", [{"confirm": "kill"}, {"confirm": "kill", "nonce": "guess"}, {"nonce": "guess"},
                                   {"confirm": "kill", "nonce": None}, {"confirm": True}])  # fmt: skip
def test_a_kill_in_one_message_kills_nothing(extra: dict[str, Any]) -> None:
    assert "ask for it first" in refusal(PageCommands(), message(1, "kill", **extra), AFTER_S)


@pytest.mark.parametrize("late_s", [0.0, AFTER_S - 0.01, UNTIL_S + 0.01, 3600.0])
def test_a_confirmation_has_its_time_and_only_one(late_s: float) -> None:
    reader = PageCommands()
    nonce = asked(reader)
    confirmation = {"confirm": "kill", "nonce": nonce}
    assert "confirm after 1.5 s and before 10 s" in refusal(reader, message(2, "kill", **confirmation), late_s)
    assert "ask for it first" in refusal(reader, message(3, "kill", **confirmation), AFTER_S)


def test_a_confirmation_is_of_the_newest_question_of_this_vehicle_and_page() -> None:
    reader = PageCommands()
    first, second = asked(reader, 1), asked(reader, 2)
    assert "not the nonce" in refusal(reader, message(3, "kill", confirm="kill", nonce=first), AFTER_S)
    second = asked(reader, 4)
    assert "not the nonce" in refusal(reader, message(5, "kill", OTHER, confirm="kill", nonce=second), AFTER_S)
    second = asked(PageCommands())
    asked(reader, 6)
    assert "not the nonce" in refusal(reader, message(7, "kill", confirm="kill", nonce=second), AFTER_S)


@pytest.mark.parametrize("extra", [{"confirm": "yes"}, {}, {"confirm": "kill", "why": "x"}])
def test_a_confirmation_says_kill_and_nothing_else(extra: dict[str, Any]) -> None:
    reader = PageCommands()
    assert refusal(reader, message(2, "kill", nonce=asked(reader), **extra), AFTER_S)
