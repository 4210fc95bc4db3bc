"""Effects of the link's faults on datagrams, in either direction."""

import numpy as np
import pytest

from mock_autopilot.faults.catalogue import FROM, TO
from mock_autopilot.faults.link import LinkFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.faults.sentences import parse
from mock_autopilot.px4.vocabulary import Mode
from tests.mock_autopilot.bench import NO_GPS, Bench

EVERY_S = 0.01
BEGIN_S, END_S = 1.0, 2.0


def _passed(sentence: str, direction: str = TO, seed: int = 1) -> list[tuple[float, bytes]]:
    """Return arrival times and datagrams of 300 sent every 10 ms; the fault is active from 1 s to 2 s."""
    schedule = FaultSchedule([parse(f"{sentence} on the ground after {BEGIN_S:g} s for {END_S - BEGIN_S:g} s")])
    link = LinkFaults(schedule, np.random.default_rng(seed), direction)
    arrived = []
    for number in range(350):
        now_s = number * EVERY_S
        schedule.step(now_s, False, False, False)
        sent = [number.to_bytes(12, "little")] if number < 300 else []
        arrived += [(now_s, item) for item in link.pass_on(sent, now_s)]
    return arrived


def _numbers(arrived: list[tuple[float, bytes]]) -> list[int]:
    return [int.from_bytes(item, "little") for _, item in arrived]


@pytest.mark.parametrize("direction", [TO, FROM])
def test_off_loses_everything_in_the_directions_it_names(direction: str) -> None:
    assert _numbers(_passed("link off", direction)) == [*range(100), *range(200, 300)]
    assert _numbers(_passed(f"link off ({direction})", direction)) == [*range(100), *range(200, 300)]
    other = FROM if direction == TO else TO
    assert _numbers(_passed(f"link off ({other})", direction)) == list(range(300))


def test_delayed_comes_later_in_order_and_in_the_end_at_once() -> None:
    arrived = _passed("link delayed by 0.2 s")
    assert _numbers(arrived) == list(range(300))
    late = [at_s - number * EVERY_S for (at_s, _), number in zip(arrived, range(300), strict=True)]
    assert late[100:180] == pytest.approx([0.2] * 80, abs=1e-6)
    assert late[205:] == pytest.approx([0.0] * 95, abs=1e-6)


def test_slow_loses_a_share_regularly() -> None:
    kept = [number for number in _numbers(_passed("link slow by 0.8")) if 100 <= number < 200]
    assert len(kept) == 20
    assert set(np.diff(kept)) == {5}


def test_intermittent_loses_a_share_at_random_and_the_seed_decides_which() -> None:
    one, again, other = (_numbers(_passed("link intermittent by 0.3", seed=seed)) for seed in (1, 1, 2))
    assert one == again != other
    assert 50 < sum(100 <= number < 200 for number in one) < 90


def test_garbage_damages_bytes_and_what_is_no_bytes_is_lost() -> None:
    arrived = _passed("link garbage by 0.5")
    assert len(arrived) == 300
    whole = {number.to_bytes(12, "little") for number in range(300)}
    wrong = [item for _, item in arrived if item not in whole]
    assert 30 < len(wrong) < 70
    assert all(len(item) == 12 for item in wrong)
    schedule = FaultSchedule([parse("link garbage by 1")])
    schedule.step(0.0, False, False, False)
    assert LinkFaults(schedule, np.random.default_rng(1), FROM).pass_on([object()], 0.0) == []


def test_an_autopilot_that_hears_no_setpoints_lands_and_says_so() -> None:
    bench = Bench(NO_GPS | {"COM_OBL_RC_ACT": 4}, faults=["link off (to the autopilot) at 6 s"])
    bench.vision = True
    bench.run(5.0)
    bench.fly_offboard(1.5)
    while bench.world.vehicle.mode is Mode.OFFBOARD and bench.now_s < 60.0:
        bench.run(0.02)
    (held,) = bench.world.faults.active(parse("link off").part)
    after_s = bench.now_s - held.since_s - bench.world.vehicle.params["COM_OF_LOSS_T"]
    assert after_s == pytest.approx(0.08, abs=0.05), "PX4 was recorded to notice it 0.09 to 0.105 s late"
    beats = len(bench.all("HEARTBEAT", held.since_s))
    bench.run(3.0)
    assert len(bench.all("HEARTBEAT", held.since_s)) >= beats + 3, "it is still heard"


def test_a_silent_autopilot_flies_on_and_its_late_messages_are_as_old_as_they_are() -> None:
    bench = Bench(faults=["link off (from the autopilot) on the ground after 5 s for 2 s"])
    bench.run(8.0)
    heard_s = [sent.time_s for sent in bench.all("ATTITUDE")]
    assert not any(5.0 < at_s < 7.0 for at_s in heard_s)
    late = Bench(faults=["link delayed by 0.5 s on the ground after 5 s"])
    late.run(8.0)
    ages_s = [sent.time_s - sent.message.time_boot_ms / 1e3 for sent in late.all("ATTITUDE", 5.6)]
    assert ages_s == pytest.approx([0.5] * len(ages_s), abs=0.005)
