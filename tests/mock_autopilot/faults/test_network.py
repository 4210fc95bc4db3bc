"""Effects of the network's faults on datagrams, in either direction."""

import math

import numpy as np
import pytest

from mock_autopilot.faults.catalogue import DOWN, UP
from mock_autopilot.faults.network import NetworkFaults, impairment_of
from mock_autopilot.faults.schedule import ActiveFault, FaultSchedule
from mock_autopilot.faults.sentences import parse
from mock_autopilot.impairment import CUT, Impairment
from mock_autopilot.impairment import parse as link

EVERY_S = 0.01
BEGIN_S, END_S = 10.0, 40.0


def _passed(sentence: str, direction: str = UP, base: str = "clean", seed: int = 1) -> list[tuple[float, int]]:
    """Return arrival times and numbers of datagrams sent every 10 ms; the fault is active from 10 s to 40 s."""
    schedule = FaultSchedule([parse(f"{sentence} on the ground after {BEGIN_S:g} s for {END_S - BEGIN_S:g} s")])
    network: NetworkFaults[int] = NetworkFaults(schedule, direction, link(base), seed)
    arrived = []
    for number in range(6000):
        now_s = number * EVERY_S
        schedule.step(now_s, False, False, False)
        arrived += [(now_s, item) for item in network.pass_on([number] if number < 5000 else [], now_s, 45)]
    return arrived


def _during(arrived: list[tuple[float, int]]) -> list[int]:
    return [number for _, number in arrived if BEGIN_S <= number * EVERY_S < END_S - 1e-9]


def test_off_cuts_the_directions_it_names_and_what_was_under_way_still_comes() -> None:
    for direction, other in ((UP, DOWN), (DOWN, UP)):
        for sentence in ("network off", f"network off ({direction})"):
            arrived = _passed(sentence, direction, base="delay 50 ms")
            assert [number for _, number in arrived] == [*range(1000), *range(4000, 5000)]
        assert len(_passed(f"network off ({other})", direction)) == 5000


@pytest.mark.parametrize(
    ("sentence", "share", "within"),
    [
        ("network intermittent by 0.3", 0.3, 0.03),
        ("network intermittent (bursts of 0.1 s) by 0.3", 0.3, 0.02),
        ("network intermittent (bursts of 0.3 s) by 0.5", 0.5, 0.02),
        ("network slow to 2.25 kB/s", 0.5, 0.01),
    ],
)
def test_a_share_is_lost_while_it_lasts_and_nothing_before_or_after(sentence: str, share: float, within: float) -> None:
    arrived = _passed(sentence)
    assert 1.0 - len(_during(arrived)) / 3000 == pytest.approx(share, abs=within)
    assert len(arrived) - len(_during(arrived)) == 2000


def test_bursts_cut_both_directions_at_the_same_times() -> None:
    sentence = "network intermittent (bursts of 0.1 s) by 0.3"
    assert _passed(sentence, UP) == _passed(sentence, DOWN)
    assert _passed("network intermittent", UP) != _passed("network intermittent", DOWN)
    assert _passed(sentence, seed=1) != _passed(sentence, seed=2)


def test_delay_jitter_and_order() -> None:
    late = dict((number, at_s - number * EVERY_S) for at_s, number in _passed("network delayed by 0.05 s"))  # noqa: C402
    assert [late[number] for number in (500, 2000, 4500)] == pytest.approx([0.0, 0.05, 0.0], abs=1e-6)
    jittered = [at_s - number * EVERY_S for at_s, number in _passed("network delayed (jitter) by 0.05 s")[1000:4000]]
    assert np.quantile(jittered, [0.01, 0.5, 0.99]) == pytest.approx([0.005, 0.03, 0.055], abs=0.006)
    swapped = np.diff(_during(_passed("network wrong (reordered) by 0.2"))) < 0
    assert np.mean(swapped) == pytest.approx(0.2, abs=0.03)
    assert len(_during(_passed("network wrong (duplicated) by 0.2"))) == pytest.approx(3600, abs=100)


def test_faults_come_on_top_of_each_other_and_of_the_links_own_impairment() -> None:
    held = [ActiveFault(parse(say), 0.0) for say in ("network delayed by 0.05 s", "network intermittent (up) by 0.5")]
    assert impairment_of(held, UP, link("loss 50% delay 5 ms")) == link("loss 75% delay 55 ms")
    assert impairment_of(held, DOWN) == Impairment(delay_s=0.05)
    assert impairment_of([ActiveFault(parse("network off"), 0.0)], UP) == CUT
    assert math.isinf(CUT.rate_bytes_per_s)
