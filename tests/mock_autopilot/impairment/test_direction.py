"""One impaired direction, in time that is an argument: shares, order, delays, and that the seed decides."""

import itertools
import math

import numpy as np
import pytest

from mock_autopilot.impairment import CUT, ImpairedDirection, parse

EVERY_S = 0.01
Arrivals = list[tuple[float, int]]


def passed(sentence: str, count: int = 10_000, seed: int = 1, every_s: float = EVERY_S, size: int = 40) -> Arrivals:
    """Return arrival times and numbers of datagrams that were sent regularly from 0 s on."""
    direction: ImpairedDirection[int] = ImpairedDirection(parse(sentence), seed)
    arrived: Arrivals = []
    for number in range(count):
        while direction.next_s <= number * every_s:
            at_s = direction.next_s
            arrived += [(at_s, item) for item in direction.due(at_s)]
        direction.put(number * every_s, number, size)
    while direction.next_s < math.inf:
        at_s = direction.next_s
        arrived += [(at_s, item) for item in direction.due(at_s)]
    assert direction.counts.arrived + direction.counts.lost == direction.counts.sent == count
    assert direction.counts.arrived_bytes == size * len(arrived)
    return arrived


def numbers(arrived: Arrivals) -> list[int]:
    return [number for _, number in arrived]


def delays_s(arrived: Arrivals) -> list[float]:
    return [at_s - number * EVERY_S for at_s, number in arrived]


def test_a_clean_link_passes_everything_at_once_and_in_order() -> None:
    arrived = passed("clean")
    assert numbers(arrived) == list(range(10_000))
    assert delays_s(arrived) == pytest.approx([0.0] * 10_000, abs=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.9])
def test_the_share_lost_is_the_one_asked_for(share: float) -> None:
    lost = 1.0 - len(passed(f"loss {100 * share:g}%")) / 10_000
    assert lost == pytest.approx(share, abs=4.0 * math.sqrt(share * (1.0 - share) / 10_000))


def runs(arrived: Arrivals, count: int) -> list[int]:
    """Return the lengths of the runs of lost datagrams between arrivals."""
    there = np.zeros(count, dtype=bool)
    there[numbers(arrived)] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[True], there, [True]]).astype(int)))
    return list(edges[1::2] - edges[::2])


@pytest.mark.parametrize(("share", "burst_ms"), [(0.1, 100), (0.3, 100), (0.3, 300), (0.7, 50)])
def test_bursts_have_their_length_and_together_the_share_of_time(share: float, burst_ms: int) -> None:
    count = 60_000
    arrived = passed(f"loss {100 * share:g}% burst {burst_ms} ms", count)
    assert 1.0 - len(arrived) / count == pytest.approx(share, abs=0.005)
    lengths = runs(arrived, count)[1:-1]  # the first and the last may be cut
    assert min(lengths) >= burst_ms // 10 - 1, "a burst is never shorter"
    assert max(lengths) <= 2 * (burst_ms // 10 + 1), "two may follow each other"
    assert np.median(lengths) == pytest.approx(burst_ms / 10, abs=burst_ms / 10 if share > 0.5 else 1.0)


def test_loss_by_itself_has_no_bursts() -> None:
    assert max(runs(passed("loss 10%"), 10_000)) <= 5


def test_bursts_cut_directions_with_the_same_burst_seed_at_the_same_times() -> None:
    def lost(seed: int, burst_seed: int | None) -> list[bool]:
        direction: ImpairedDirection[int] = ImpairedDirection(parse("loss 30% burst 100 ms"), seed, burst_seed)
        found = []
        for number in range(1000):
            before = direction.counts.lost
            direction.put(1e6 + number * EVERY_S, number)
            found.append(direction.counts.lost > before)
        return found

    assert lost(1, 7) == lost(2, 7) == lost(7, None) != lost(1, 8)


def test_delay_is_the_same_for_all_and_keeps_the_order() -> None:
    arrived = passed("delay 25 ms", 1000)
    assert numbers(arrived) == list(range(1000))
    assert delays_s(arrived) == pytest.approx([0.025] * 1000, abs=1e-9)


def test_jitter_is_uniform_and_a_large_one_lets_others_overtake() -> None:
    arrived = passed("delay 5 ms jitter 20 ms")
    late_s = np.array(delays_s(arrived))
    assert late_s.min() == pytest.approx(0.005, abs=1e-4)
    assert late_s.max() == pytest.approx(0.025, abs=1e-4)
    assert np.quantile(late_s, [0.25, 0.5, 0.75]) == pytest.approx([0.01, 0.015, 0.02], abs=5e-4)
    overtaken = np.mean(np.diff(numbers(arrived)) < 0)
    assert 0.05 < overtaken < 0.2, "jitter of twice the interval: the next overtakes with probability 1/8"
    assert numbers(passed("jitter 9 ms")) == list(range(10_000)), "jitter below the interval keeps the order"


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5])
def test_reordered_datagrams_arrive_behind_their_successor(share: float) -> None:
    order = numbers(passed(f"reorder {100 * share:g}%"))
    assert sorted(order) == list(range(10_000))
    swapped = [number for number, following in itertools.pairwise(order) if number == following + 1]
    assert len(swapped) / 10_000 == pytest.approx(share, abs=0.02)
    assert max(abs(number - place) for place, number in enumerate(order)) == 1


def test_duplicates_arrive_twice_each_with_its_own_jitter() -> None:
    direction: ImpairedDirection[int] = ImpairedDirection(parse("duplicate 10% jitter 5 ms"))
    for number in range(10_000):
        direction.put(number * EVERY_S, number, 40)
    arrived = direction.due(math.inf)
    assert len(arrived) / 10_000 == pytest.approx(1.1, abs=0.012)
    assert set(arrived) == set(range(10_000))
    assert set(numbers(passed("loss 10%", 1000))) == set(numbers(passed("loss 10% reorder 5%", 1000)))


def test_a_reordered_datagram_without_successor_arrives_after_a_tenth_of_a_second() -> None:
    arrived = passed("reorder 50%", 1)
    assert delays_s(arrived) == pytest.approx([0.1])


def test_a_rate_lets_pass_so_many_bytes_and_a_full_queue_loses_the_rest() -> None:
    arrived = passed("rate 2 kB/s", 1000, size=40)  # 4 kB/s are sent
    assert len(arrived) * 40 / 10.0 == pytest.approx(2000, rel=0.05)
    assert max(delays_s(arrived)) < 0.2 + 0.021
    assert len(passed("rate 4 kB/s", 1000, size=40)) == 1000, "what fits is not lost"
    (first, *_) = passed("rate 4 kB/s", 10, size=400)
    assert first[0] == pytest.approx(0.1), "a large datagram takes its time"


def test_the_seed_decides_which_are_lost_whatever_else_is_impaired() -> None:
    one, again, other = (set(numbers(passed("loss 10%", 1000, seed=seed))) for seed in (1, 1, 2))
    assert one == again != other
    assert set(numbers(passed("loss 10% jitter 50 ms reorder 5%", 1000))) == one
    assert passed("loss 10% jitter 20 ms reorder 5%", 1000) == passed("loss 10% jitter 20 ms reorder 5%", 1000)


def test_a_change_concerns_what_is_sent_after_it() -> None:
    direction: ImpairedDirection[str] = ImpairedDirection(parse("delay 1 s"))
    direction.put(0.0, "late")
    direction.set(CUT)
    direction.put(0.1, "lost")
    direction.set(parse("clean"))
    direction.put(0.2, "at once")
    assert direction.due(0.2) == ["at once"]
    assert direction.due(0.9) == []
    assert direction.next_s == pytest.approx(1.0)
    assert direction.due(1.0) == ["late"]
    assert str(direction.counts) == "3 sent (0 bytes), 1 lost (33.3%), 2 arrived"


def test_bytes_know_their_size() -> None:
    direction: ImpairedDirection[bytes] = ImpairedDirection(parse("rate 1 kB/s"))
    direction.put(0.0, bytes(100))
    assert direction.next_s == pytest.approx(0.1)
