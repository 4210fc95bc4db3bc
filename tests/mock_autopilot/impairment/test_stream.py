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
            for data in stream.due(at_s):  # what had to wait comes in full segments
                read.extend((at_s, int.from_bytes(data[at : at + 40], "little")) for at in range(0, len(data), 40))

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
    stream = ImpairedStream(parse("delay 5 ms"))
    stream.put(0.0, b"one")
    assert stream.due(0.005) == [b"one"]
    stream.set(CUT)
    stream.put(0.03, b"two")
    stream.set(parse("delay 5 ms"))
    stream.put(0.06, b"three")
    assert stream.due(0.0749) == []
    assert stream.due(0.075) == [b"two", b"three"], (
        "three arrives at 65 ms, is acknowledged at 70 ms, two comes at 75 ms"
    )


def test_a_lost_segment_without_successor_is_probed_for_and_then_waits_for_time_outs_which_double() -> None:
    stream = ImpairedStream(CUT)
    stream.put(0.0, b"alone")
    for again_s in (0.2, 0.4, 0.8, 1.6):
        assert stream.next_s == pytest.approx(again_s)
        assert stream.due(again_s) == []
    stream.set(parse("delay 10 ms"))
    assert stream.due(3.2) == []
    assert stream.next_s == pytest.approx(3.21)
    assert stream.due(3.21) == [b"alone"]
    assert stream.counts.lost == 5
    assert stream.waiting_bytes == 0


def test_a_burst_holds_up_everything_until_it_is_over() -> None:
    late_s = ages_s("delay 5 ms loss 10% burst 100 ms")
    assert np.median(late_s) == pytest.approx(0.005)
    assert np.quantile(late_s, 0.9) > 0.03
    assert late_s.max() > 0.1


def test_the_window_shrinks_under_random_loss_until_it_cannot_keep_up() -> None:
    few, many = (np.quantile(ages_s(f"delay 2 ms loss {share}%", 2000), 0.9) for share in (2, 30))
    assert few < 0.05
    assert many > 1.0, "real TCP stalls at 30 % as well"


def test_lost_acknowledgements_cost_little_while_later_ones_come() -> None:
    stream = ImpairedStream(parse("delay 5 ms"))
    stream.set(parse("delay 5 ms"), back=parse("loss 50% delay 5 ms"))
    for number in range(1000):
        stream.put(number * EVERY_S, b"x")
        assert stream.due(number * EVERY_S + 0.006) == [b"x"]


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
