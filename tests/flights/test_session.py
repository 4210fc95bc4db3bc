"""A whole session as an operator has it: service, mocks and every command a process of its own, on a real broker.

In mid-flight the broker is killed and begun again, an operator's command is killed, and a second operator commands.
"""

import signal
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pytest

from tests.flights.served import Seen, Served, Site, kill, looking_on, mocks, serving
from tests.flights.split_session import flies, params_name_the_place_of_the_law, preflight_has_lines_for_the_link
from tests.mosquitto import Lab, lab, needs_mosquitto

pytestmark = pytest.mark.realtime

LAP = ("--laps", "1", "--period", "8", "--size", "0.5")
"""Long enough for a broker to come back and for a second operator to begin a command, on a busy computer, too."""
REFUSED = 2


Restart = Callable[[Served, Seen], Awaitable[None]]
"""Kills the broker and has it begun again."""


async def session(site: Site, restart: Restart) -> None:
    """Fly a session with the law on board."""
    async with mocks(site), serving(site.config(), site.folder / "log") as served:
        await served.says("the vehicle is there")
        async with looking_on(site.place, served) as seen:
            await seen.phase("standby")
            await succeeds(site, "preflight")
            await flown(site, served, seen, restart)
            await succeeds(site, "controller", "pid")
            assert (await seen.newer()).controller == "pid"
            await a_killed_command_harms_nothing(site, seen)
            await landed(site, seen)
        served.process.send_signal(signal.SIGTERM)
        assert await served.ended() == 0
    assert len(list(site.records.glob("*.mcap"))) == 1


async def split_session(site: Site, restart: Restart) -> None:
    """Fly the same session with the law on the ground."""
    config, folder = site.config(law_on_ground=True), site.folder
    async with (
        mocks(site),
        serving(config, folder / "vehicle.log") as served,
        serving(config, folder / "ground.log", "law") as ground,
    ):
        await served.says("the vehicle is there")
        await ground.says("has taken the law etnn")
        async with looking_on(site.place, served) as seen:
            await seen.phase("standby")
            await preflight_has_lines_for_the_link(site)
            await flown(site, served, seen, restart)
            for law in ("pid", "etnn"):
                await succeeds(site, "controller", law)
                await flies(seen, law)
            await a_killed_command_harms_nothing(site, seen)
            await params_name_the_place_of_the_law(site)
            await landed(site, seen)
        for service in (ground, served):
            service.process.send_signal(signal.SIGTERM)
            assert await service.ended() == 0
    of_ground = sorted("-ground-" in path.name for path in site.records.glob("*.mcap"))
    assert of_ground == [False, True], "a record of the vehicle's, and the ground's"


async def flown(site: Site, served: Served, seen: Seen, restart: Restart) -> None:
    for words in (("arm",), ("takeoff", "--height", "0.6")):
        await succeeds(site, *words)
    await the_broker_comes_back_while_it_tracks(site, served, seen, restart)


async def landed(site: Site, seen: Seen) -> None:
    await succeeds(site, "land")
    await seen.phase("disarmed")
    assert not seen.state.armed


async def succeeds(site: Site, *words: str) -> None:
    ran = await site.command(*words)
    assert ran.code == 0, f"{words}: {ran.said}"


async def the_broker_comes_back_while_it_tracks(site: Site, served: Served, seen: Seen, restart: Restart) -> None:
    tracking = await site.begin("track", "ellipse", "--arms", "swing", *LAP)
    doing = (await tracking.meanwhile(seen.phase("track"))).doing
    await restart(served, seen)
    state = await seen.newer()
    assert (state.phase, state.doing) == ("track", doing), "the flight goes on"
    second = await site.command("goto", "0", "0", "1")
    assert second.code == REFUSED, second.said
    assert "track" in second.err
    assert "still under way: wait, or run `companion hold`" in second.err
    ran = await tracking.ended()
    assert ran.code == 0, ran.said
    assert "connected again" in ran.said
    assert seen.state.phase == "hold"


async def a_killed_command_harms_nothing(site: Site, seen: Seen) -> None:
    tracking = await site.begin("track", "figure8", *LAP)
    await tracking.meanwhile(seen.does("track"))
    tracking.kill()
    assert (await tracking.ended()).code == -signal.SIGKILL
    state = await seen.phase("track")
    assert state.doing is not None, "the flight goes on"
    await succeeds(site, "hold")
    assert (await seen.newer()).phase == "hold", "at once, although another command was under way"


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Lab]:
    (tmp_path / "mosquitto").mkdir()
    with lab(tmp_path / "mosquitto") as there:
        yield there


@needs_mosquitto
async def test_a_session_over_mosquitto_with_login_and_tls(room: Lab, tmp_path: Path) -> None:
    async def restart(_: Served, seen: Seen) -> None:
        before = len(seen.links)
        room.broker.stop()
        await seen.served.until(lambda: len(seen.links) > before, seen.story)
        room.broker.start()
        await seen.served.until(lambda: seen.links[-1], seen.story)

    site = Site.embedded(tmp_path)
    await session(Site(tmp_path, site.ports, room.place("anna"), room.place("dauam-1")), restart)


async def test_a_session_with_the_law_on_the_ground_over_the_embedded_broker(tmp_path: Path) -> None:
    async def restart(served: Served, seen: Seen) -> None:
        before = len(seen.links)
        kill(served.broker())
        await seen.served.until(lambda: len(seen.links) > before and seen.links[-1], seen.story)

    await split_session(Site.embedded(tmp_path), restart)
