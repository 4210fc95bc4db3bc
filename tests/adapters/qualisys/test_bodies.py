"""QTM's list of rigid bodies changes while we are connected: no other body may become the vehicle."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Literal

import numpy as np
import pytest
from qtm_rt.packet import QRTPacket

from companion.adapters.mocap.newest_frame import MocapCounts
from companion.adapters.qualisys import stream_watch
from companion.adapters.qualisys.bodies import RigidBody, index_in_frame, misfit, objection, rigid_bodies
from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.packets import MalformedError
from companion.adapters.qualisys.source import QualisysSource
from mock_autopilot.faults.mocap import MocapFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.faults.sentences import parse
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.server import QualisysServer
from tests.adapters.qualisys.qtm_scripts import LEVEL_BODY, frame
from tests.adapters.qualisys.rig import ManualClock, capturing, settings_for

BOX, DAUAM, WAND = RigidBody("box"), RigidBody("dauam"), RigidBody("wand")
OFF = RigidBody("box", enabled=False)
OTHER_BODY = [3000.0, 3000.0, 0.0, *LEVEL_BODY[3:]]
OURS_W_M = (0.0, 0.0, 1.0)
"""Position of our body in `capturing`."""


def test_bodies_come_in_the_order_of_the_data() -> None:
    xml = (
        b"<Q><The_6D><Body><Name>b</Name><Enabled>false</Enabled></Body><Body><Name> a&amp;c </Name>"
        b'<Data_origin X="0" Relative_body="2">1</Data_origin></Body><Euler/></The_6D></Q>'
    )
    assert rigid_bodies(xml) == (RigidBody("b", enabled=False), RigidBody("a&c", relative=True))


@pytest.mark.parametrize("xml", [b"", b"<QTM", b"<?xml version='1.0' encoding='klingon'?><a/>"])
def test_settings_that_are_no_xml_are_refused(xml: bytes) -> None:
    with pytest.raises(MalformedError, match="settings that are no XML"):
        rigid_bodies(xml)


@pytest.mark.parametrize(
    ("bodies", "why"),
    [
        ((), "has no rigid bodies: define 'dauam'"),
        ((BOX, OFF), "does not know the body 'dauam'; it has: box, box (disabled)"),
        ((DAUAM, BOX, DAUAM), "has 2 bodies called 'dauam'"),
        ((RigidBody("dauam", enabled=False),), "does not track 'dauam': it is disabled there"),
        ((RigidBody("dauam", relative=True), BOX), "gives the pose of 'dauam' relative to another body"),
        ((BOX, RigidBody("wand", relative=True), OFF, DAUAM), ""),
    ],
)
def test_a_body_that_cannot_be_flown_by_is_refused_with_the_reason(bodies: tuple[RigidBody, ...], why: str) -> None:
    assert objection(bodies, "dauam").startswith(why)
    assert bool(objection(bodies, "dauam")) == bool(why)


@pytest.mark.parametrize(
    ("bodies", "count", "place"),
    [
        ((BOX, DAUAM), 2, 1),
        ((OFF, DAUAM, WAND), 3, 1),
        ((OFF, DAUAM, WAND), 2, 0),
        ((BOX, DAUAM), 1, None),
        ((BOX, DAUAM), 3, None),
        ((DAUAM,), 0, None),
    ],
)
def test_the_number_of_bodies_tells_whether_disabled_ones_are_in_a_frame(
    bodies: tuple[RigidBody, ...], count: int, place: int | None
) -> None:
    assert index_in_frame(bodies, "dauam", count) == place


def test_many_bodies_are_not_all_named() -> None:
    assert misfit([RigidBody(f"b{number}") for number in range(300)], 3).endswith("b18, b19, ...")


def source_of(*bodies: RigidBody) -> QualisysSource:
    source = QualisysSource("dauam", "here:1", ManualClock())
    source.take_bodies(bodies)
    return source


def give(source: QualisysSource, number: int, *bodies: list[float]) -> float | None:
    """One frame; where our body is along x afterwards."""
    source.on_packet(QRTPacket(frame(number, number * 10_000, list(bodies))[8:]))
    latest = source.latest()
    return None if latest is None else float(latest.position_w_m[0])


def test_a_frame_of_another_number_of_bodies_is_not_believed_until_the_list_was_read() -> None:
    source = source_of(DAUAM)
    assert give(source, 1, LEVEL_BODY) == 1.0
    assert give(source, 2, OTHER_BODY, LEVEL_BODY) == 1.0
    assert source.list_wanted.is_set()
    give(source, 3, LEVEL_BODY)
    assert source.counts == MocapCounts(received=1, doubted=2), "nor one that fits the old list again"
    source.take_bodies((BOX, DAUAM))
    give(source, 4, OTHER_BODY, LEVEL_BODY)
    latest = source.latest()
    assert latest is not None
    assert (latest.frame, latest.position_w_m[0]) == (4, 1.0)


def test_no_frame_is_believed_while_the_list_may_have_changed() -> None:
    source = source_of(DAUAM)
    give(source, 1, LEVEL_BODY)
    source.doubt_bodies()
    give(source, 2, OTHER_BODY)
    assert source.counts == MocapCounts(received=1, doubted=1)
    assert source.take_bodies((BOX,)) == "does not know the body 'dauam'; it has: box"
    give(source, 3, OTHER_BODY)
    assert source.counts == MocapCounts(received=1, doubted=2)
    assert source.trouble == "does not know the body 'dauam'; it has: box"


def test_a_list_that_does_not_fit_the_frames_is_read_again() -> None:
    """The settings may be older than the frames."""
    source = source_of(DAUAM)
    give(source, 1, OTHER_BODY, LEVEL_BODY)
    assert source.trouble == "sends frames of 2 rigid bodies, and its settings have 1: dauam"
    source.take_bodies((DAUAM,))
    give(source, 2, OTHER_BODY, LEVEL_BODY)
    assert source.list_wanted.is_set()
    source.take_bodies((BOX, DAUAM))
    assert give(source, 3, OTHER_BODY, LEVEL_BODY) == 1.0
    assert source.trouble == ""


@asynccontextmanager
async def changing(
    transport: Literal["tcp", "udp"] = "tcp", **settings: Any
) -> AsyncIterator[tuple[QualisysServer, FaultSchedule, QualisysSource]]:
    """The mock QTM with frames flowing, what changes its bodies, and the adapter connected to it."""
    schedule = FaultSchedule()
    config = QualisysConfig(**({"port": 0, "noise_m": 0.0, "noise_rad": 0.0, "delay_s": 0.0} | settings))
    server = QualisysServer(config, 1, MocapFaults(schedule, np.random.default_rng(1), config.rate_hz))
    await server.start()
    try:
        async with capturing(server), open_qualisys(settings_for(server, transport=transport), CLOCK) as source:
            yield server, schedule, source
    finally:
        await server.stop()


CLOCK = ManualClock()
QUIET_S = 0.15


async def poses_for(source: QualisysSource, for_s: float) -> set[tuple[float, ...]]:
    """Every place that our body was seen at, m."""
    loop, places = asyncio.get_running_loop(), set[tuple[float, ...]]()
    end_s = loop.time() + for_s
    while (left_s := end_s - loop.time()) > 0.0:
        if await source.wait_frame(left_s):
            latest = source.latest()
            assert latest is not None
            places.add(tuple(latest.position_w_m.round(3).tolist()))
    return places


@pytest.mark.realtime
@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize("told", [True, False], ids=["told", "untold"])
class TestTheListChanges:
    """Over both ways, with QTM's event for changed settings, and without."""

    async def test_a_body_that_is_added_or_taken_away_moves_ours_and_it_is_followed(
        self, transport: Literal["tcp", "udp"], told: bool
    ) -> None:
        async with changing(transport, tells_changes=told) as (_, schedule, source):
            schedule.inject(parse("mocap wrong (body added)"), 0.0)
            assert await poses_for(source, 2 * QUIET_S) == {OURS_W_M}
            assert await source.wait_frame(5.0)

    @pytest.mark.parametrize("what", ["body deleted", "no bodies"])
    async def test_without_our_body_there_are_no_frames(
        self, transport: Literal["tcp", "udp"], told: bool, what: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        async with changing(transport, tells_changes=told, extra_bodies=("wand",)) as (_, schedule, source):
            schedule.inject(parse(f"mocap wrong ({what})"), 0.0)
            assert await poses_for(source, QUIET_S) <= {OURS_W_M}
            assert not await source.wait_frame(QUIET_S)
            assert source.trouble
        told_once = [r for r in caplog.records if r.getMessage().startswith("no frames are believed: ")]
        assert [record.levelno for record in told_once] == [logging.ERROR]


@pytest.mark.realtime
@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("body replaced", "does not know the body 'dauam'; it has: box, wand"),
        ("body renamed", "does not know the body 'dauam'; it has: box, wand"),
        ("body disabled", "does not track 'dauam': it is disabled"),
    ],
)
async def test_a_change_that_keeps_the_number_is_known_by_qtms_event(
    transport: Literal["tcp", "udp"], what: str, why: str
) -> None:
    async with changing(transport, extra_bodies=("wand",)) as (_, schedule, source):
        schedule.inject(parse(f"mocap wrong ({what})"), 0.0)
        assert await poses_for(source, QUIET_S) <= {OURS_W_M}
        assert not await source.wait_frame(QUIET_S)
        assert source.trouble.startswith(why)


@pytest.mark.realtime
async def test_bodies_that_change_their_order_are_followed() -> None:
    async with changing(extra_bodies=("box", "wand")) as (_, schedule, source):
        schedule.inject(parse("mocap wrong (bodies reversed)"), 0.0)
        assert await poses_for(source, 2 * QUIET_S) == {OURS_W_M}


@pytest.mark.realtime
async def test_a_change_that_nobody_tells_and_no_number_shows_is_found_by_looking(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stream_watch, "EVERY_S", 0.05)
    async with changing(tells_changes=False) as (_, schedule, source):
        schedule.inject(parse("mocap wrong (body replaced)"), 0.0)
        async with asyncio.timeout(5.0):
            while not source.trouble:  # noqa: ASYNC110 - the far side of a socket
                await asyncio.sleep(0.01)
        assert source.trouble == "does not know the body 'dauam'; it has: box"
        await source.wait_frame(0.0)
        assert not await source.wait_frame(QUIET_S)


@pytest.mark.realtime
async def test_our_body_may_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_watch, "EVERY_S", 0.05)
    async with changing(tells_changes=False) as (_, schedule, source):
        schedule.inject(parse("mocap wrong (body renamed) for 5 s"), 0.0)
        async with asyncio.timeout(5.0):
            while not source.trouble:  # noqa: ASYNC110 - the far side of a socket
                await asyncio.sleep(0.01)
        schedule.step(6.0, False, False, False)
        await source.wait_frame(0.0)
        assert await source.wait_frame(5.0)
        assert source.trouble == ""


@pytest.mark.realtime
async def test_a_qtm_with_another_project_is_told_of_once(caplog: pytest.LogCaptureFixture) -> None:
    async with changing() as (server, _, source):
        port = server.port
        await server.stop()
        other = QualisysServer(QualisysConfig(port=port, body="table"), 1)
        await other.start()
        async with capturing(other):
            assert await poses_for(source, 3 * QUIET_S) <= {OURS_W_M}
        await other.stop()
    assert caplog.text.count("does not know the body 'dauam'; it has: table") == 1
