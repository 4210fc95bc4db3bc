"""Silence is the time since the ground law confirmed the command that the vehicle holds."""

import pytest

from companion.law_link.messages import UpFlags
from tests.law_link.ends import HOVER, Joined, shown


def silence_s(ends: Joined) -> float:
    return ends.vehicle.status(ends.now_s).silence_s


def test_a_beat_confirms_the_command_that_is_held() -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    for _ in range(10):
        ends.cycle()
        assert silence_s(ends) < 0.04


def test_a_beat_after_a_lost_command_does_not_confirm_the_old_one() -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    ends.ground.command(HOVER)
    ends.sent()  # and lost
    for _ in range(10):
        ends.deliver([datagram for datagram in ends.sent() if len(datagram) < 40])  # beats alone get through
    assert silence_s(ends) == pytest.approx(0.11, abs=0.002)
    assert ends.vehicle.status(ends.now_s).received > 2


def test_while_nothing_is_acknowledged_every_cycle_sends_the_command() -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    for _ in range(30):
        ends.cycle()
    again = ends.ground.counts.again
    for _ in range(10):
        ends.cycle()
    assert ends.ground.counts.again == again + 10
    ends.report(shown(1))
    for _ in range(10):
        ends.cycle()
    assert ends.ground.counts.again == again + 10


def test_a_command_that_a_beat_has_overtaken_is_used_and_confirmed() -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    ends.ground.command(HOVER)
    late = ends.sent()
    for _ in range(4):
        beats = [datagram for datagram in ends.sent() if len(datagram) < 40]
        ends.deliver(beats)
    before_s = silence_s(ends)
    ends.deliver(late)
    assert before_s == pytest.approx(0.05, abs=0.002)
    assert silence_s(ends) == pytest.approx(0.04, abs=0.002), "the beat that overtook it was sent then"
    held = ends.vehicle.use(ends.now_s)
    assert held is not None
    assert held.number == 2


@pytest.mark.parametrize("flag", [UpFlags.BLIND, UpFlags.FAILED])
def test_a_ground_law_that_cannot_compute_confirms_nothing(flag: UpFlags) -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    ends.ground.flags |= flag
    for _ in range(20):
        ends.cycle()
    assert silence_s(ends) == pytest.approx(0.2, abs=0.002)


def test_on_the_ground_beats_confirm_whatever_was_commanded_before() -> None:
    ends = Joined()
    ends.fly()
    ends.cycle(HOVER)
    ends.ground.command(HOVER)
    ends.sent()  # and lost, at the very end of a flight
    ends.report(shown(0, airborne=False))
    ends.ground.flags = UpFlags(0)
    events = ends.ground.counts.events + ends.ground.counts.again
    for _ in range(20):
        ends.cycle()
    assert silence_s(ends) < 0.04
    assert ends.ground.counts.events + ends.ground.counts.again == events, "nobody acknowledges it, so none is repeated"


def test_events_in_every_cycle_leave_room_for_the_clock() -> None:
    ends = Joined(offset_s=1000.0)
    ends.fly()
    for _ in range(60):
        ends.cycle(HOVER)
        ends.vehicle.use(ends.now_s)
        ends.report(shown(ends.ground.newest_number))
    assert ends.vehicle.status(ends.now_s).age_s == pytest.approx(0.0, abs=1e-3), "the age of commands is known"


def test_an_answer_to_a_question_does_not_replace_a_beat() -> None:
    ends = Joined()
    ends.vehicle.ask('{"controller": "pid"}', ends.now_s)
    for _ in range(5):
        asked = ends.vehicle.poll(ends.now_s)
        if asked is not None:
            ends.ground.hear(asked, ends.now_s)
        if ends.ground.asked is not None and ends.ground.asked.text:
            ends.ground.answer(ends.ground.asked, "{}")
        ends.cycle()
        assert silence_s(ends) < 0.04
    assert ends.vehicle.answers == ["{}"]


@pytest.mark.parametrize("jump_s", [0.4, 20.0, -0.4])
def test_a_clock_that_jumps_is_known_again_after_one_exchange(jump_s: float) -> None:
    ends = Joined(offset_s=1000.0)
    ends.fly()
    for _ in range(20):
        ends.cycle(HOVER)
        ends.report(shown(ends.ground.newest_number))
    assert ends.ground.clock.offset_s == pytest.approx(-1000.0, abs=1e-3)
    ends.offset_s += jump_s
    for _ in range(50):
        ends.cycle(HOVER)
        ends.report(shown(ends.ground.newest_number))
    assert ends.ground.clock.offset_s == pytest.approx(-1000.0 - jump_s, abs=1e-3)
    assert silence_s(ends) < 0.04, "and the vehicle was told at once"
