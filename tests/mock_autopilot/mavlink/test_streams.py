"""Messages that PX4 does not stream faster, or only on change (its sources, mavlink module)."""

import pytest

from tests.mock_autopilot.bench import NO_GPS, Bench

SET_INTERVAL, ACCEPTED, FAILED = 511, 0, 4
HEARTBEAT, CURRENT_MODE = 0.0, 436.0


@pytest.mark.parametrize("interval_us", [50_000.0, -1.0, 0.0])
def test_the_heartbeat_keeps_its_rate_whatever_is_asked(interval_us: float) -> None:
    bench = Bench(NO_GPS)
    bench.run(2.1)
    assert bench.command(SET_INTERVAL, HEARTBEAT, interval_us) == [FAILED]
    since_s = bench.now_s
    bench.run(4.0)
    assert len(bench.all("HEARTBEAT", since_s)) == 4


def test_the_current_mode_comes_at_once_when_it_changes_and_else_twice_a_second() -> None:
    bench = Bench(NO_GPS)
    bench.run(3.0)
    assert bench.command(SET_INTERVAL, CURRENT_MODE, 50_000.0) == [ACCEPTED]
    since_s = bench.now_s
    bench.run(4.0)
    assert 7 <= len(bench.all("CURRENT_MODE", since_s)) <= 9
    bench.target(0.0)
    bench.run(0.3)
    since_s = bench.now_s
    bench.mode(6)
    shown = [sent for sent in bench.all("CURRENT_MODE", since_s) if sent.message.custom_mode == 0x60000]
    assert shown[0].time_s - since_s < 0.06
