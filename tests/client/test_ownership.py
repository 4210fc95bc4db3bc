"""Tests of what a client has begun and what ends it: replies and states in every order, no broker."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.client.command_draft import CommandDraft
from companion.client.ownership import REMEDIES, Ownership
from companion.protocol.commands import VERBS
from companion.protocol.telemetry import Answer, Doing, Reply, State

FIELDS: dict[str, dict[str, object]] = {
    "goto": {"x_m": 0.0, "y_m": 0.0, "z_m": 1.0},
    "track": {"curve": "ellipse"},
    "arms": {"do": "stow"},
    "controller": {"name": "pid"},
    "kill": {"confirm": "kill"},
}
"""Fields that a verb must have."""


def draft(verb: str) -> CommandDraft:
    return CommandDraft(verb, **FIELDS.get(verb, {}))


def reply(command: CommandDraft, answer: Answer, time_s: float) -> Reply:
    return Reply(id=command.id, answer=answer, time_s=time_s)


def state(time_s: float, armed: bool, doing: CommandDraft | None = None) -> State:
    under_way = None if doing is None else Doing(id=doing.id, verb=doing.verb)
    return State(time_s=time_s, session="0" * 16, phase="hold", armed=armed, doing=under_way)


@pytest.mark.parametrize("verb", VERBS)
def test_only_what_begins_a_flight_makes_it_ones_own(verb: str) -> None:
    own, command = Ownership(), draft(verb)
    own.hear(state(0.0, armed=True))
    own.begins(command)
    own.hear(reply(command, Answer.ACCEPTED, 1.0))
    own.hear(state(1.1, armed=True, doing=command))
    assert own.owns_flight == (verb in {"arm", "takeoff", "resume"})
    assert own.under_way(command)
    own.hear(reply(command, Answer.DONE, 2.0))
    assert not own.any_under_way


def test_a_flight_is_ones_own_until_the_vehicle_is_seen_disarmed() -> None:
    own, arm, takeoff = Ownership(), draft("arm"), draft("takeoff")
    own.begins(arm)
    assert own.owns_flight, "it may have been carried out although nothing is heard"
    own.hear(reply(arm, Answer.ACCEPTED, 1.0))
    own.hear(state(1.1, armed=False))
    assert own.owns_flight, "the checks before arming are under way"
    own.hear(state(2.0, armed=True))
    own.hear(reply(arm, Answer.DONE, 2.1))
    own.begins(takeoff)
    own.hear(reply(takeoff, Answer.REFUSED, 2.2))
    assert own.owns_flight, "it is still armed"
    own.hear(state(3.0, armed=False))
    own.hear(state(4.0, armed=True))
    assert not own.owns_flight, "somebody else armed it"


@pytest.mark.parametrize("verb", ["land", "abort", "disarm", "kill"])
def test_a_flight_that_this_client_has_ended_is_over_before_the_next_state(verb: str) -> None:
    own, arm, end = Ownership(), draft("arm"), draft(verb)
    own.begins(arm)
    own.hear(reply(arm, Answer.DONE, 1.0))
    own.begins(end)
    own.hear(reply(end, Answer.ACCEPTED, 2.0))
    own.hear(state(2.1, armed=True))
    assert own.owns_flight
    own.hear(reply(end, Answer.DONE, 3.0))
    assert not own.owns_flight


def test_states_of_the_flight_before_do_not_end_the_next_one() -> None:
    """Land, then arm at once: states that were under way on the network still tell of the first flight."""
    own, first, second = Ownership(), draft("arm"), draft("arm")
    own.begins(first)
    own.hear(reply(first, Answer.ACCEPTED, 1.0))
    own.hear(state(2.0, armed=True))
    own.begins(second)
    own.hear(reply(second, Answer.ACCEPTED, 3.0))
    own.hear(state(2.9, armed=True))
    own.hear(state(3.1, armed=False))
    assert own.owns_flight


@pytest.mark.parametrize(("answer", "accepted"), [(Answer.REFUSED, False), (Answer.FAILED, True)])
def test_an_arming_that_came_to_nothing_owns_nothing(answer: Answer, accepted: bool) -> None:
    own, command = Ownership(), draft("arm")
    own.begins(command)
    if accepted:
        own.hear(reply(command, Answer.ACCEPTED, 1.0))
    own.hear(reply(command, answer, 2.0))
    assert not own.owns_flight


def test_what_certainly_was_not_sent_is_not_under_way() -> None:
    own, command = Ownership(), draft("takeoff")
    own.begins(command)
    own.is_not_sent(command)
    assert not own.owns_flight
    assert not own.any_under_way


@pytest.mark.parametrize("verb", REMEDIES)
def test_what_is_under_way_is_ended_but_not_the_command_of_another(verb: str) -> None:
    own, command = Ownership(), draft(verb)
    own.begins(command)
    own.hear(reply(command, Answer.ACCEPTED, 1.0))
    assert own.remedies(state(1.1, True, command)) == REMEDIES[verb]
    hidden = verb == "arms"
    assert own.remedies(state(1.1, True, draft("goto"))) == (REMEDIES["arms"] if hidden else ())
    own.hear(reply(command, Answer.DONE, 2.0))
    assert own.remedies(state(2.1, True, command)) == ()


STEPS = st.lists(
    st.tuples(st.sampled_from(VERBS), st.sampled_from([None, Answer.ACCEPTED, Answer.DONE, Answer.REFUSED]))
    | st.booleans(),
    max_size=30,
)
"""Commands with their replies, None when none comes; and states with the vehicle armed or not."""


@given(STEPS)
def test_a_client_that_began_no_flight_never_owns_one(steps: list[tuple[str, Answer | None] | bool]) -> None:
    own, began = Ownership(), False
    for time_s, step in enumerate(steps):
        if isinstance(step, bool):
            own.hear(state(time_s, armed=step))
            continue
        verb, answer = step
        command = draft(verb)
        own.begins(command)
        if answer is not None:
            own.hear(reply(command, answer, time_s))
        began = began or (verb in {"arm", "takeoff", "resume"} and answer is not Answer.REFUSED)
    assert began or not own.owns_flight


@given(STEPS)
def test_after_a_flight_that_was_seen_to_end_nothing_is_owned(steps: list[tuple[str, Answer | None] | bool]) -> None:
    own = Ownership()
    for time_s, step in enumerate(steps):
        if isinstance(step, bool):
            own.hear(state(time_s, armed=step))
            continue
        command = draft(step[0])
        own.begins(command)
        if step[1] is not None:
            own.hear(reply(command, step[1], time_s))
    own.hear(state(100.0, armed=True))
    own.hear(state(101.0, armed=False))
    assert not own.owns_flight
