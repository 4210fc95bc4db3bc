"""Sessions: who gets one, who does not, and that nothing else than its own messages is ever taken."""

from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import Command
from companion.law_link.vehicle_end import VehicleEnd
from tests.law_link.ends import HOVER, KEY, ME, Joined, shown

ELSEWHERE = replace(ME, host="laptop")


def ground(who: Introduction = ELSEWHERE, key: bytes = KEY, seed: int = 2) -> GroundEnd:
    return GroundEnd(key, who, Random(seed).randbytes, beat_s=0.03)


def meet(vehicle: VehicleEnd, end: GroundEnd, begin_s: float, for_s: float = 1.0) -> None:
    """Let both speak for a while."""
    for cycle in range(round(for_s / 0.01)):
        now_s = begin_s + 0.01 * cycle
        for datagram in end.tick(now_s):
            reply = vehicle.hear(datagram, now_s, "laptop")
            if reply is not None:
                end.hear(reply, now_s)


def held(vehicle: VehicleEnd, now_s: float) -> int:
    """Return the number of the command held; 0 without one."""
    command = vehicle.use(now_s)
    return 0 if command is None else command.number


def test_a_ground_law_gets_a_session_and_its_commands_are_held() -> None:
    joined = Joined()
    status = joined.vehicle.status(joined.now_s)
    assert (status.connected, status.law, status.host, status.refused) == (True, "etnn", "ground", "")
    joined.fly()
    joined.cycle(HOVER)
    assert held(joined.vehicle, joined.now_s) == joined.ground.newest_number == 1


@pytest.mark.parametrize(
    ("who", "reason"),
    [
        (replace(ELSEWHERE, version="9"), "install the same version on both"),
        (replace(ELSEWHERE, protocol=7), "install the same version on both"),
        (replace(ELSEWHERE, agreed={}), "vehicle.mass_kg is 4.85 on the vehicle and not there on the ground"),
    ],
)
def test_one_that_differs_is_refused_with_the_reason_on_both_sides(who: Introduction, reason: str) -> None:
    vehicle, end = VehicleEnd(KEY, ME, Random(1).randbytes), ground(who)
    meet(vehicle, end, 0.0)
    assert not vehicle.status(1.0).connected
    assert reason in end.refused
    assert vehicle.status(1.0).refused == end.refused
    assert end.refused_for_s(1.0) > 0.5
    assert vehicle.status(1.0).rival == "", "no second one: it is another one"


def test_with_another_key_nothing_is_even_answered() -> None:
    vehicle, end = VehicleEnd(KEY, ME, Random(1).randbytes), ground(key=b"another key, as long")
    meet(vehicle, end, 0.0)
    status = vehicle.status(0.9)
    assert (status.connected, status.foreign, status.foreign_from) == (False, 2, "laptop")
    assert (end.session, end.refused) == (None, "")


def test_a_second_ground_law_is_refused_while_the_first_one_lives() -> None:
    joined, second = Joined(), ground()
    for _ in range(100):
        joined.cycle()
        meet(joined.vehicle, second, joined.now_s, 0.01)
    assert second.session is None
    assert "the ground law on ground has this vehicle" in second.refused
    status = joined.vehicle.status(joined.now_s)
    assert (status.host, status.rival) == ("ground", "laptop")


def test_in_a_flight_nobody_new_is_taken_even_if_the_first_one_is_gone() -> None:
    joined, second = Joined(), ground()
    joined.vehicle.locked = True
    meet(joined.vehicle, second, joined.now_s + 5.0)
    assert second.refused.startswith("a flight is on")
    assert second.refused_for_s(joined.now_s + 6.0) == 0.0, "that ends by itself"
    assert joined.vehicle.status(joined.now_s + 6.0).host == "ground"


def test_a_session_that_was_offered_before_the_flight_does_not_begin_in_it() -> None:
    vehicle, end = VehicleEnd(KEY, ME, Random(1).randbytes), ground()
    [hello] = end.tick(0.0)
    welcome = vehicle.hear(hello, 0.0, "laptop")
    assert welcome is not None
    vehicle.locked = True
    end.hear(welcome, 0.01)
    for datagram in end.tick(0.02):
        vehicle.hear(datagram, 0.02, "laptop")
    assert not vehicle.status(0.03).connected


def test_after_the_first_one_is_gone_another_one_may_begin_on_the_ground() -> None:
    joined, second = Joined(), ground()
    meet(joined.vehicle, second, joined.now_s + 1.1)
    assert joined.vehicle.status(joined.now_s + 2.0).host == "laptop"


def test_a_recording_of_a_session_moves_nothing_in_it_and_nothing_in_the_next() -> None:
    joined = Joined()
    joined.fly()
    recorded = [datagram for cycle in range(50) for datagram in joined.cycle(HOVER if cycle % 10 == 0 else None)]
    before, number = joined.vehicle.received, held(joined.vehicle, joined.now_s)
    joined.now_s += 0.01
    joined.deliver(recorded)
    assert joined.vehicle.received == before
    assert held(joined.vehicle, joined.now_s) == number
    assert joined.vehicle.status(joined.now_s).foreign == len(recorded)
    other = Joined(seed=2)
    other.fly()
    other.deliver(recorded)
    assert held(other.vehicle, other.now_s) == 0


@settings(max_examples=30)
@given(st.lists(st.binary(max_size=80), max_size=300))
def test_garbage_changes_nothing_but_the_count_of_foreign_datagrams(garbage: list[bytes]) -> None:
    joined = Joined()
    joined.fly()
    joined.cycle(HOVER)
    before = joined.vehicle.status(joined.now_s)
    for datagram in garbage:
        assert joined.vehicle.hear(datagram, joined.now_s, "stranger") is None
        joined.ground.hear(datagram, joined.now_s)
    after = joined.vehicle.status(joined.now_s)
    assert after == replace(before, foreign=len(garbage), foreign_from="stranger" if garbage else "")
    assert held(joined.vehicle, joined.now_s) == 1


@settings(max_examples=30)
@given(st.data())
def test_a_changed_message_is_dropped_whatever_was_changed(data: st.DataObject) -> None:
    joined = Joined()
    joined.fly()
    joined.ground.command(Command(accel_w_mps2=(1.0, 2.0, 3.0), yaw_rad=0.5, capture_ago=10))
    for datagram in joined.sent():
        bit = data.draw(st.integers(0, 8 * len(datagram) - 1))
        changed = bytearray(datagram)
        changed[bit // 8] ^= 1 << bit % 8
        joined.deliver([bytes(changed)])
    assert held(joined.vehicle, joined.now_s) == 0


def test_a_lost_command_is_sent_again_until_it_is_acknowledged_and_no_longer() -> None:
    joined = Joined()
    joined.fly()
    for _ in range(60):
        joined.cycle()
        joined.report(shown(0))
    joined.ground.command(HOVER)
    joined.sent()  # lost
    for _ in range(10):
        joined.cycle()
        number = held(joined.vehicle, joined.now_s)
        joined.report(shown(number))
        if number:
            break
    assert held(joined.vehicle, joined.now_s) == 1
    again = joined.ground.counts.again
    assert again >= 1
    for _ in range(50):
        joined.cycle()
        joined.report(shown(1))
    assert joined.ground.counts.again == again
