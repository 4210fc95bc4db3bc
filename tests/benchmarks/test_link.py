"""The link's benchmark: its messages and its arithmetic. A run needs network namespaces and minutes."""

import math

import pytest

from benchmarks.link.__main__ import table
from benchmarks.link.message import BEAT_BYTES, EVENT_BYTES, PERIOD_S, pack, unpack
from benchmarks.link.run import figures, model_tcp
from benchmarks.link.summary import ages_ms, held_ages_ms, percentile
from benchmarks.link.transports import TRANSPORTS, missing


def test_a_message_has_its_size_and_is_refused_when_a_bit_is_wrong() -> None:
    assert [len(pack(number, 0.0)) for number in range(4)] == [EVENT_BYTES, BEAT_BYTES, BEAT_BYTES, EVENT_BYTES]
    assert unpack(pack(7, 1.5)) == (7, 1.5)
    assert unpack(pack(7, 1.5)[:-1] + b"x") is None
    assert unpack(b"") is None


def test_ages_are_of_first_arrivals() -> None:
    assert ages_ms([(0, 0.0, 0.01), (1, 1.0, 1.005), (0, 0.0, 0.5)]) == pytest.approx([5.0, 10.0])
    assert percentile([1.0, 2.0, 3.0, 4.0], 0.5) == 3.0
    assert percentile([1.0, 2.0], 1.0) == 2.0
    assert math.isnan(percentile([], 0.5))


def test_the_age_held_grows_until_a_newer_message_arrives_and_an_older_one_does_not_matter() -> None:
    held = held_ages_ms([(0, 0.0, 0.1), (2, 0.2, 0.3), (1, 0.1, 0.35)], 0.1, 0.5)
    assert held[-1] == pytest.approx(300.0, abs=2.0), "the second is 0.2 s old at 0.4 s, 0.3 s at the end"
    assert held[0] == pytest.approx(100.0, abs=2.0)
    assert len(held) == pytest.approx(400, abs=1)


def test_figures_and_their_table() -> None:
    arrivals = [(number, number * PERIOD_S, number * PERIOD_S + 0.004) for number in range(90)]
    one = figures("datagram", "loss 10%", arrivals, 100, (0.0, 2.7), (5800, 0))
    assert one.lost == 10
    assert one.age_median_ms == pytest.approx(4.0)
    assert one.wire_up_bytes_per_s == pytest.approx(2148.1, abs=1.0)
    assert one.held_median_ms == pytest.approx(19.0, abs=1.0)
    assert (
        table([one])
        .splitlines()[-1]
        .endswith("| loss 10% | datagram | 4.0 | 4 | 4 | 20 | 34 | 34 | 10.0% | 2148 | 0 |")
    )


def test_the_relays_model_of_tcp_loses_nothing_and_waits() -> None:
    model = model_tcp("loss 10% delay 2 ms", 30.0, 1)
    assert model.lost == 0
    assert model.age_median_ms == pytest.approx(2.0)
    assert model.age_longest_ms > 30.0


def test_every_transport_can_be_measured_or_says_why_not() -> None:
    assert missing("datagram") == ""
    assert all(
        missing(name) in {"", "eclipse-zenoh is not installed", "mosquitto is not installed"} for name in TRANSPORTS
    )
