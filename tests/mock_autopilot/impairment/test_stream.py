"""One impaired direction of a TCP connection: nothing is lost or out of order, and a loss costs time."""

import math

import numpy as np
import pytest

from mock_autopilot.impairment import CUT, ImpairedStream, parse

EVERY_S = 0.03
Array = np.ndarray


def ages_s(sentence: str, count: int = 4000, seed: int = 1) -> Array:
    """Return how old each of `count` messages is on arrival; they are written every 30 ms."""
    stream = ImpairedStream(parse(sentence), seed)
    read: list[tuple[float, int]] = []

    def read_until(time_s: float) -> None:
        while stream.next_s <= time_s and stream.next_s < math.inf:
            at_s = stream.next_s
            read.extend((at_s, int.from_bytes(data, "little")) for data in stream.due(at_s))

    for number in range(count):
        read_until(number * EVERY_S)
        stream.put(number * EVERY_S, number.to_bytes(40, "little"))
    read_until(math.inf)
    assert [number for _, number in read] == list(range(count)), "all, in order"
    assert stream.waiting_bytes == 0
    return np.array([at_s - number * EVERY_S for at_s, number in read])


def test_delay_and_jitter_keep_the_order_of_bytes() -> None:
    assert ages_s("delay 5 ms") == pytest.approx(0.005)
    late_s = ages_s("delay 5 ms jitter 50 ms")
    assert late_s.min() >= 0.005
    assert late_s.max() <= 0.055 + 1e-9


def test_a_lost_segment_comes_when_a_later_one_is_acknowledged() -> None:
    late_s = ages_s("delay 5 ms loss 10%")
    assert np.mean(late_s <= 0.005 + 1e-9) == pytest.approx(0.8, abs=0.04), "it holds up the one behind it, too"
    resent_s = np.unique(late_s[late_s > 0.04].round(6))
    assert resent_s[0] == pytest.approx(0.03 + 0.01 + 0.005), "next message 30 ms later, round trip, way"


def test_a_lost_segment_without_successor_waits_for_the_time_out_which_doubles() -> None:
    stream = ImpairedStream(CUT)
    stream.put(0.0, b"alone")
    assert stream.next_s == pytest.approx(0.2)
    assert stream.due(0.2) == []
    assert stream.next_s == pytest.approx(0.2 + 0.4)
    stream.set(parse("delay 10 ms"))
    assert stream.due(0.6) == []
    assert stream.next_s == pytest.approx(0.61)
    assert stream.due(0.61) == [b"alone"]
    assert stream.next_s > 0.61
    assert stream.counts.lost == 2


def test_a_burst_holds_up_everything_until_it_is_over() -> None:
    late_s = ages_s("delay 5 ms loss 30% burst 300 ms")
    assert np.median(late_s) == pytest.approx(0.005)
    assert 0.3 < late_s.max() < 1.5


def test_a_rate_delays_and_loses_nothing() -> None:
    stream = ImpairedStream(parse("rate 10 kB/s"))
    stream.put(0.0, bytes(5000))
    read, at_s = 0, 0.0
    while stream.next_s < math.inf:
        at_s = stream.next_s
        read += sum(len(data) for data in stream.due(at_s))
    assert read == 5000
    assert at_s == pytest.approx(0.5)


def test_the_seed_decides() -> None:
    one, again, other = (ages_s("loss 10% jitter 20 ms", 500, seed) for seed in (1, 1, 2))
    assert (one == again).all()
    assert (one != other).any()
