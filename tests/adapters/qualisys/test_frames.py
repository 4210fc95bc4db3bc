"""Bytes to frames without sockets: hand-written packets, the slot's order, and what garbage may do."""

import asyncio
import math
import struct
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from qtm_rt.packet import QRTPacket

from companion.adapters.mocap.newest_frame import MocapCounts
from companion.adapters.qualisys.bodies import RigidBody
from companion.adapters.qualisys.link import Datagrams, Link
from companion.adapters.qualisys.packets import MalformedError, body_count, body_pose, check_packet, split_packets
from companion.adapters.qualisys.source import QualisysSource
from companion.core.interfaces import MocapError
from tests.adapters.qualisys.qtm_scripts import COMMAND, DATA, EVENT, GOOD, LEVEL_BODY, WELCOME, XML, frame, packet
from tests.adapters.qualisys.rig import ManualClock

LEFT_BODY = [0.0, 0.0, 0.0, 0, 1, 0, -1, 0, 0, 0, 0, 1, 0.5]
"""A quarter turn to the left, column by column: the nose (column 1) points to y."""


def source_of(*before: str) -> QualisysSource:
    """A source that has read QTM's list: ours behind those."""
    source = QualisysSource("dauam", "here:1", ManualClock())
    assert source.take_bodies((*map(RigidBody, before), RigidBody("dauam"))) == ""
    return source


def give(source: QualisysSource, number: int, stamp_us: int) -> None:
    source.on_packet(QRTPacket(frame(number, stamp_us, [LEVEL_BODY])[8:]))


def test_packets_are_taken_whole_and_the_rest_is_kept() -> None:
    buffer = bytearray(WELCOME + WELCOME[:10])
    assert split_packets(buffer) == [WELCOME]
    assert buffer == WELCOME[:10]


@pytest.mark.parametrize(
    ("size", "kind"), [(0, DATA), (7, XML), (0xFFFFFFFF, COMMAND), (15_000_000, DATA), (10, EVENT), (64_001, 17)]
)
def test_a_size_that_cannot_be_is_refused(size: int, kind: int) -> None:
    """15 MB for a frame would swallow hours of frames before it is whole."""
    with pytest.raises(MalformedError, match=f"{size} bytes"):
        split_packets(bytearray(struct.pack("<II", size, kind)))


def test_a_count_that_would_keep_the_sdk_busy_for_ever_is_refused() -> None:
    with pytest.raises(MalformedError, match="4294967295 components"):
        check_packet(packet(DATA, struct.pack("<qIIII", 0, 1, 0xFFFFFFFF, 0, 5)))


def test_a_pose_is_read_in_metres_and_by_columns() -> None:
    pose = body_pose(QRTPacket(frame(1, 0, [LEVEL_BODY, LEFT_BODY])[8:]), 1)
    assert pose.rotation_w_b.tolist() == [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert (pose.rotation_w_b @ np.array([1.0, 0.0, 0.0])).tolist() == [0, 1, 0], "the nose points to the left"
    first = body_pose(QRTPacket(frame(1, 0, [LEVEL_BODY, LEFT_BODY])[8:]), 0)
    assert first.position_w_m.tolist() == [1.0, 2.0, 3.0]
    assert first.residual_m == pytest.approx(0.0005)


def test_a_frame_without_6dres_has_no_bodies() -> None:
    assert body_count(QRTPacket(struct.pack("<qIIIIihh", 0, 1, 1, 16, 6, 0, 0, 0))) == 0


@pytest.mark.parametrize("count", [-1, 1, 2**31 - 1])
def test_a_frame_that_is_shorter_than_its_bodies_is_refused(count: int) -> None:
    with pytest.raises(MalformedError, match="ends too early"):
        body_count(QRTPacket(struct.pack("<qIIIIihh", 0, 1, 1, 16, 11, count, 0, 0)))
    with pytest.raises(MalformedError, match="ends too early"):
        body_count(QRTPacket(frame(1, 0, [LEVEL_BODY])[8:-4]))


def test_frames_that_were_overtaken_or_repeated_are_dropped_and_counted() -> None:
    source = source_of()
    for number in (1, 3, 2, 3, 4):
        give(source, number, number * 10_000)
    latest = source.latest()
    assert latest is not None
    assert latest.frame == 4
    assert source.counts == MocapCounts(received=3, lost=1, late=2, malformed=0)
    assert latest.late == 2, "the health checks know of it"


def test_live_frames_that_are_all_numbered_alike_are_ordered_by_their_stamps() -> None:
    source = source_of()
    for stamp_us in (10_000, 20_000, 30_000):
        give(source, 1, stamp_us)
    assert source.counts == MocapCounts(received=3)


def test_a_new_measurement_starts_again_from_zero() -> None:
    source = source_of()
    give(source, 5000, 50_000_000)
    give(source, 1, 10_000)
    latest = source.latest()
    assert latest is not None
    assert latest.frame == 1
    assert source.counts == MocapCounts(received=2)


@pytest.mark.parametrize(("back_us", "dropped"), [(1, True), (200_000, True), (200_001, False), (990_000, False)])
def test_a_clock_that_jumps_back_is_not_taken_for_frames_that_were_overtaken(back_us: int, dropped: bool) -> None:
    """Dropped frames count as silence, which lasts no longer than motion capture may be silent."""
    source = source_of()
    give(source, 5000, 50_000_000)
    give(source, 5001, 50_000_000 - back_us)
    assert source.counts.late == int(dropped)


def test_frames_after_a_broken_packet_are_doubted_and_more_after_many() -> None:
    source = source_of()
    give(source, 1, 10_000)
    source.on_malformed(MalformedError("rubbish"))
    for number in range(2, 6):
        give(source, number, number * 10_000)
    assert source.counts == MocapCounts(received=2, lost=3, malformed=1, doubted=3)
    for _ in range(100):
        source.on_malformed(MalformedError("rubbish"))
    for number in range(6, 17):
        give(source, number, number * 10_000)
    assert source.counts == MocapCounts(received=3, lost=13, malformed=101, doubted=13)


async def test_the_first_reason_of_a_failure_stays() -> None:
    source = source_of()
    source.fail("sent rubbish")
    source.fail("closed the connection")
    with pytest.raises(MocapError, match=r"^QTM at here:1 sent rubbish$"):
        await source.wait_frame(0.0)


async def test_a_failure_wakes_the_one_who_waits() -> None:
    source = source_of()
    waiting = asyncio.create_task(source.wait_frame(60.0))
    await asyncio.sleep(0)
    source.fail("closed the connection")
    with pytest.raises(MocapError):
        await waiting


def test_datagrams_from_elsewhere_are_ignored() -> None:
    source = source_of()
    Datagrams(source, "10.0.0.1").datagram_received(frame(1, 0, [LEVEL_BODY]), ("10.0.0.2", 5))
    assert source.latest() is None
    Datagrams(source, "10.0.0.1").datagram_received(frame(1, 0, [LEVEL_BODY]), ("10.0.0.1", 5))
    assert source.latest() is not None


def garbled(stream: bytes) -> st.SearchStrategy[bytes]:
    """The stream cut short, with some bytes changed, or anything at all."""
    positions = st.dictionaries(st.integers(0, len(stream) - 1), st.integers(0, 255), max_size=6)

    def change(changes: dict[int, int], end: int) -> bytes:
        changed = bytearray(stream)
        for at, value in changes.items():
            changed[at] = value
        return bytes(changed[:end])

    return st.binary(max_size=200) | st.builds(change, positions, st.integers(0, len(stream)))


@settings(max_examples=300)
@given(data=garbled(frame(7, 70_000, [LEVEL_BODY, LEFT_BODY])))
def test_a_garbled_datagram_is_a_frame_or_is_counted(data: bytes) -> None:
    source = source_of("leader")
    Datagrams(source, "x").datagram_received(data, ("x", 1))
    assert source.counts.received + source.counts.malformed <= 1


class FakeTransport(asyncio.BaseTransport):
    """Takes what is written and knows whether it was broken off."""

    aborted = False

    def write(self, data: bytes) -> None:
        """Discard the data: the transport has no reader."""

    def abort(self) -> None:
        self.aborted = True


async def fed_link(pieces: list[bytes]) -> tuple[Link, FakeTransport, list[str]]:
    """A link in full conversation, with a stream asked for, that receives these pieces."""
    link, transport, failures = Link(), FakeTransport(), list[str]()
    link.connection_made(transport)
    link.on_failure = failures.append
    link.set_on_packet(source_of("leader").on_packet)
    asking = asyncio.ensure_future(link.settings("6d"))
    answers = [link.send_command(word) for word in ("version 1.25", "streamframes allframes 6dres")]
    await asyncio.sleep(0)
    for piece in pieces:
        if not transport.aborted:
            link.data_received(piece)
    for answer in answers:
        if answer.done():
            answer.exception()
    asking.cancel()
    await asyncio.gather(asking, return_exceptions=True)
    return link, transport, failures


CONVERSATION = WELCOME + GOOD["version"] + GOOD["getparameters"] + frame(7, 70_000, [LEVEL_BODY, LEFT_BODY])


@settings(max_examples=300)
@given(data=garbled(CONVERSATION), cut=st.integers(0, len(CONVERSATION)))
async def test_a_garbled_stream_never_raises_and_ends_with_a_reason(data: bytes, cut: int) -> None:
    _, transport, failures = await fed_link([data[:cut], data[cut:]])
    assert transport.aborted == bool(failures)


@settings(max_examples=100)
@given(cuts=st.lists(st.integers(0, len(CONVERSATION)), max_size=8))
async def test_a_stream_may_come_in_any_pieces(cuts: list[int]) -> None:
    edges = [0, *sorted(cuts), len(CONVERSATION)]
    link, transport, failures = await fed_link([CONVERSATION[a:b] for a, b in pairwise(edges)])
    assert not transport.aborted
    assert failures == []
    assert link.on_packet.__self__.counts == MocapCounts(received=1)


@settings(max_examples=200)
@given(values=st.lists(st.floats(width=32), min_size=13, max_size=13))
def test_any_numbers_make_a_frame_that_says_whether_it_is_tracked(values: list[float]) -> None:
    source = source_of()
    source.on_packet(QRTPacket(frame(1, 0, [values])[8:]))
    latest: Any = source.latest()
    assert latest.tracked == all(math.isfinite(value) for value in values[:12])
