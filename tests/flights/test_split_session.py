"""A whole session with the law on the ground: both services, mocks and every command a process of its own."""

import json
import signal
from pathlib import Path

import pytest

from tests.flights.served import Seen, Site, looking_on, mocks, serving
from tests.flights.test_session import succeeds

pytestmark = pytest.mark.realtime

LAP = ("--laps", "1", "--period", "5", "--size", "0.3", "--height", "0.5")


async def test_a_session_with_the_law_on_the_ground(tmp_path: Path) -> None:
    site = Site.embedded(tmp_path)
    config = site.config(law_on_ground=True)
    async with (
        mocks(site),
        serving(config, tmp_path / "vehicle.log") as vehicle,
        serving(config, tmp_path / "ground.log", "law") as ground,
    ):
        await vehicle.says("the vehicle is there")
        await ground.says("has taken the law etnn")
        async with looking_on(site.place, vehicle) as seen:
            await seen.phase("standby")
            await preflight_has_lines_for_the_link(site)
            for words in (("arm",), ("takeoff", "--height", "0.5"), ("track", "ellipse", "--arms", "swing", *LAP)):
                await succeeds(site, *words)
            for law in ("pid", "etnn"):
                await succeeds(site, "controller", law)
                await flies(seen, law)
            assert seen.state.law_link is not None
            assert seen.state.law_link.connected
            await params_name_the_place_of_the_law(site)
            await succeeds(site, "land")
            await seen.phase("disarmed")
            assert not seen.state.armed
        for service in (ground, vehicle):
            service.process.send_signal(signal.SIGTERM)
            assert await service.ended() == 0
    of_ground = sorted("-ground-" in path.name for path in site.records.glob("*.mcap"))
    assert of_ground == [False, True], "a record of the vehicle's, and the ground's"


async def flies(seen: Seen, law: str) -> None:
    """Check that the vehicle hovers, and by which law."""
    state = await seen.newer()
    assert (state.phase, state.controller) == ("hold", f"{law} on the ground")


async def preflight_has_lines_for_the_link(site: Site) -> None:
    ran = await site.command("preflight", "--json")
    assert ran.code == 0, ran.said
    replies = [json.loads(line) for line in ran.out.splitlines()]
    [checks] = [reply["data"]["checks"] for reply in replies if reply["type"] == "reply" and reply["data"]]
    of_link = {check["name"]: check["passed"] for check in checks}
    assert of_link["ground law"], checks
    assert of_link["commands' age"], checks


async def params_name_the_place_of_the_law(site: Site) -> None:
    ran = await site.command("params", "--json")
    assert ran.code == 0, ran.said
    replies = [json.loads(line) for line in ran.out.splitlines()]
    [data] = [reply["data"] for reply in replies if reply["type"] == "reply" and reply["data"]]
    assert data["controller"]["name"] == "etnn on the ground"
    assert data["config"]["law"]["runs_on"] == "ground"
