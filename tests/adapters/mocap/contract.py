"""Contract of mocap sources that the flight loop relies on, for every source and transport."""

from typing import Protocol

import numpy as np

from companion.core.interfaces import MocapSource

ARRIVES_S = 5.0
"""Far longer than any arrival takes: only a failing test waits so long."""
NOTHING_COMES_S = 0.05


class Rig(Protocol):
    """A source and a hand on what it captures."""

    source: MocapSource

    def capture(self, position_w_m: tuple[float, float, float] = (0.0, 0.0, 1.0), tracked: bool = True) -> float:
        """Take one frame, 10 ms after the one before; returns its stamp (s). Nothing is awaited."""

    def set_clock(self, now_s: float) -> None:
        """Set the rig's monotonic clock to this time, s."""

    async def end(self) -> None:
        """Let the source's far side go away for good."""


class MocapContract:
    """Run by every class that inherits it, on its own fixture `rig`."""

    async def test_frames_keep_their_capture_time(self, rig: Rig) -> None:
        stamps = []
        for _ in range(5):
            stamp_s = rig.capture()
            assert await rig.source.wait_frame(ARRIVES_S)
            frame = rig.source.latest()
            assert frame is not None
            stamps.append((stamp_s, frame.stamp_s))
        assert all(abs(sent - got) < 1e-6 for sent, got in stamps), stamps

    async def test_arrival_is_told_by_our_clock(self, rig: Rig) -> None:
        rig.set_clock(1234.5)
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        frame = rig.source.latest()
        assert frame is not None
        assert frame.received_s == 1234.5

    async def test_positions_are_metres_in_w(self, rig: Rig) -> None:
        rig.capture(position_w_m=(1.0, -2.0, 3.0))
        assert await rig.source.wait_frame(ARRIVES_S)
        frame = rig.source.latest()
        assert frame is not None
        np.testing.assert_allclose(frame.position_w_m, (1.0, -2.0, 3.0), atol=1e-6)
        np.testing.assert_allclose(frame.rotation_w_b, np.eye(3), atol=1e-6)

    async def test_a_lost_body_is_reported_not_repeated(self, rig: Rig) -> None:
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        rig.capture(tracked=False)
        assert await rig.source.wait_frame(ARRIVES_S), "a frame without the body is a frame"
        frame = rig.source.latest()
        assert frame is not None
        assert not frame.tracked
        assert np.isnan(frame.position_w_m).all()

    async def test_the_body_comes_back(self, rig: Rig) -> None:
        rig.capture(tracked=False)
        assert await rig.source.wait_frame(ARRIVES_S)
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        frame = rig.source.latest()
        assert frame is not None
        assert frame.tracked

    async def test_without_frames_waiting_ends_in_time(self, rig: Rig) -> None:
        before = rig.source.latest()
        assert not await rig.source.wait_frame(NOTHING_COMES_S)
        assert rig.source.latest() is before, "an old frame stays what it is"

    async def test_every_wait_returns_for_a_newer_frame(self, rig: Rig) -> None:
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        assert not await rig.source.wait_frame(NOTHING_COMES_S)

    async def test_the_latest_wins_and_nothing_is_queued(self, rig: Rig) -> None:
        newest_s = [rig.capture() for _ in range(5)][-1]
        got = 0
        while await rig.source.wait_frame(NOTHING_COMES_S):
            got += 1
        frame = rig.source.latest()
        assert frame is not None
        assert abs(frame.stamp_s - newest_s) < 1e-6
        assert 1 <= got <= 5
