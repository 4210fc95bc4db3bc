"""One listener that fails takes nothing from the others."""

import math

from companion.flight.sinks import FanOutSink, LoopHeartbeat
from companion.flight.tick import Tick
from tests.records.flown import flight


def test_who_fails_is_dropped_and_the_others_go_on() -> None:
    heard: list[float] = []
    beat = LoopHeartbeat()

    def broken(tick: Tick) -> None:
        if len(heard) > 2:
            raise ValueError("a mistake")
        heard.append(tick.time_s)

    fan = FanOutSink([broken, beat])
    assert beat.ticked_s == math.inf, "before the first tick nobody is late"
    ticks = list(flight(track_s=0.2))
    for tick in ticks:
        fan(tick)
        assert beat.ticked_s == tick.time_s
    assert heard == [tick.time_s for tick in ticks[:3]]
