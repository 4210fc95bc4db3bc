"""The service as it is begun, waits, loses its devices, is ended and is killed: real processes, real time."""

import asyncio
import os
import signal
import socket
import time
from pathlib import Path

import pytest

from companion.adapters.px4.mavlink import flight_mode
from companion.core.types import FlightMode
from companion.records.read import read_flight
from tests.flights.command import run
from tests.flights.served import NO_ARMS, Served, Site, looking_on, mocks, serving
from tests.mavlink_relay import Relay

pytestmark = pytest.mark.realtime

REFUSED = 2
LAST_SECOND_S = 1.0
SILENT_WITHIN_S = 0.25
ARMED_BIT = 128
SLOWLY = ("SYS_HAS_GPS = 0", "SYS_HAS_GPS = 0\nMPC_LAND_SPEED = 0.4\nMPC_LAND_CRWL = 0.4")
"""PX4's landing, so that there is time to see what happens meanwhile."""


class Listening:
    """Socket of systemd, and what is heard on it."""

    def __init__(self, folder: Path) -> None:
        self.address, self.heard = str(folder / "notify"), [""]
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self.address)
        self._socket.setblocking(False)
        asyncio.get_running_loop().add_reader(self._socket, self._hear)

    def _hear(self) -> None:
        self.heard += self._socket.recv(4096).decode().splitlines()

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()


async def flying(site: Site, height_m: float = 0.8) -> None:
    """Armed, then in the air."""
    for words in (("arm",), ("takeoff", "--height", str(height_m))):
        ran = await site.command(*words)
        assert ran.code == 0, ran.said


async def test_devices_that_come_later_go_and_come_back(tmp_path: Path) -> None:
    site = Site.embedded(tmp_path)
    config = site.config(arms=False)
    async with serving(config, tmp_path / "log") as served:
        await served.says("no vehicle: ")
        async with looking_on(site.place, served) as seen:
            await served.until(lambda: bool(seen.states) and "QTM" in seen.state.reason, seen.story)
            waiting = seen.state
            assert waiting.phase == "waiting"
            ran = await site.command("arm")
            assert ran.code == REFUSED
            assert f"there is no vehicle yet: {waiting.reason}" in ran.err
            async with serving(config, tmp_path / "second") as second:
                assert await second.ended() == REFUSED
            already = f"a companion service (process {served.process.pid}) runs already on this computer with port "
            assert f"{already}{site.place.port}: stop it first" in second.log
            assert "Foxglove" not in second.log, "it binds nothing before it knows"
            async with mocks(site, NO_ARMS):
                await seen.well()
                assert (await site.command("params")).code == 0
            await seen.lost()
            async with mocks(site, NO_ARMS):
                await seen.well()
                assert (await site.command("params")).code == 0
        served.process.send_signal(signal.SIGTERM)
        assert await served.ended() == 0


async def test_an_operator_is_told_that_a_flight_is_not_recorded_and_sigterm_lands_first(tmp_path: Path) -> None:
    site = Site.embedded(tmp_path)
    systemd = Listening(tmp_path)
    told = {"NOTIFY_SOCKET": systemd.address, "WATCHDOG_USEC": "2000000"}
    config = site.config(arms=False)
    async with mocks(site, NO_ARMS), serving(config, tmp_path / "log", **told) as served:
        await served.says("the vehicle is there")
        async with looking_on(site.place, served) as seen:
            await flying(site)
            before = systemd.heard.count("WATCHDOG=1")
            assert before > 1, "the control loop ticks"
            await served.until(lambda: "STATUS=hold" in systemd.heard)  # ten times a second
            assert seen.state.warnings == ()
            os.kill(served.writer(), signal.SIGKILL)
            await served.until(lambda: any("not recorded" in one for one in seen.state.warnings), seen.story)
            assert any(one.kind == "log" and "not recorded" in one.text for one in seen.events), seen.story()
            served.process.send_signal(signal.SIGTERM)
            assert await served.ended() == 0
            assert [one.name for one in seen.events if one.kind == "phase"][-2:] == ["land", "disarmed"]
    heard = systemd.heard
    systemd.close()
    assert heard.count("READY=1") == heard.count("STOPPING=1") == 1
    landing = heard.index("STATUS=land: the service was told to end")
    assert heard.index("READY=1") < heard.index("STOPPING=1") < landing
    assert "WATCHDOG=1" in heard[landing:], "and while it lands"


async def test_a_service_killed_in_the_air_leaves_a_record_and_nobody_takes_over(tmp_path: Path) -> None:
    with Relay() as relay:
        first, other = (Site.embedded(tmp_path / name, relay.ports) for name in ("first", "other"))
        first.folder.mkdir()
        other.folder.mkdir()
        async with (
            mocks(first, NO_ARMS, SLOWLY),
            serving(first.config(arms=False, url=relay.url), tmp_path / "log") as served,
        ):
            await served.says("the vehicle is there")
            await flying(first, 1.5)
            async with serving(other.config(arms=False, url=relay.url), tmp_path / "other-log") as second:
                await second.says(f"no vehicle: another companion (process {served.process.pid}) already flies")
                killed_s = time.monotonic()
                served.process.kill()
                await second.says("the vehicle is there")
                ran = await other.command("arm")
                assert ran.code == REFUSED, ran.said
                assert "this service does not take control of what it did not start" in ran.err
                await lands(relay, second, killed_s)
    assert max(relay.setpoints_s()) - killed_s <= SILENT_WITHIN_S
    (path,) = first.records.glob("*.mcap")
    record = read_flight(path)
    *_, last = record.ticks()
    assert killed_s - last.time_s < LAST_SECOND_S
    assert (last.phase, record.truncated) == ("hold", False), "the writer has closed it"
    ran = await run("report", path, "--out", tmp_path / "report.html")
    assert ran.code == 0, ran.said
    assert "takeoff" in (tmp_path / "report.html").read_text(encoding="utf-8")


async def lands(relay: Relay, second: Served, since_s: float) -> None:
    """PX4's offboard loss, to the end."""

    def since() -> list[tuple[FlightMode, bool]]:
        beats = [p.message for p in relay.from_autopilot if p.kind == "HEARTBEAT" and p.time_s > since_s]
        return [(flight_mode(beat.custom_mode), bool(beat.base_mode & ARMED_BIT)) for beat in beats]

    def story() -> str:
        return str(since())

    await second.until(lambda: (FlightMode.LAND, True) in since(), story)
    await second.until(lambda: not since()[-1][1], story)
    landing = since()[since().index((FlightMode.LAND, True)) :]
    assert {mode for mode, armed in landing if armed} == {FlightMode.LAND}, "nobody disturbs it"
