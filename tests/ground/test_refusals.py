"""The service of the law on the ground when its vehicle refuses it: one sentence, and its end; loopback sockets."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import uvloop

from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.flight_config import VehicleConfig
from companion.core.errors import ConfigError
from companion.flight.assembly import controller_of
from companion.ground import ground_service
from companion.ground.ground_service import serve_law
from tests.law_link.local import PATIENCE_S, split_config, standing_vehicle, until


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CompanionConfig:
    """Ground and vehicle on one computer, without motion capture; a refusal counts after a moment."""
    monkeypatch.setattr(ground_service, "_REFUSED_S", 0.05)
    return split_config(tmp_path)


@pytest.fixture
def law(config: CompanionConfig) -> LoadedController:
    return controller_of(config, "pid")


async def ends_with(config: CompanionConfig, law: LoadedController) -> str:
    """Return the sentence with which the ground ends by itself."""
    async with asyncio.timeout(PATIENCE_S):
        with pytest.raises(ConfigError) as refused:
            await serve_law(config, law, asyncio.Event())
    return str(refused.value)


async def test_another_configuration_ends_it_with_what_differs(config: CompanionConfig, law: LoadedController) -> None:
    heavier = config.model_copy(update={"vehicle": VehicleConfig(mass_kg=5.1)})
    async with standing_vehicle(heavier):
        said = await ends_with(config, law)
    here = config.vehicle.mass_kg
    assert said == (
        f"the vehicle at 127.0.0.1 refuses this ground law: vehicle.mass_kg is 5.1 on the vehicle and {here} on the "
        "ground: give both the same configuration"
    )


async def test_another_version_ends_it_with_both_versions(
    config: CompanionConfig, law: LoadedController, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with standing_vehicle(config) as link:
        monkeypatch.setattr(link.end, "_me", replace(link.end._me, version="9.9.9"))
        said = await ends_with(config, law)
    assert "the vehicle runs companion 9.9.9" in said
    assert said.endswith("install the same version on both")


async def test_a_second_ground_law_ends_and_the_first_one_stays(config: CompanionConfig, law: LoadedController) -> None:
    async with standing_vehicle(config) as link:
        stop = asyncio.Event()
        first = asyncio.create_task(serve_law(config, law, stop))
        await until(lambda: link.end.status(MonotonicClock().now_s()).connected)
        session = link.end.status(MonotonicClock().now_s()).session
        said = await ends_with(config, law)
        assert "has this vehicle: stop it first" in said
        after = link.end.status(MonotonicClock().now_s())
        assert (after.connected, after.session) == (True, session)
        assert after.rival
        stop.set()
        await first


async def test_a_flight_that_is_on_is_waited_for(config: CompanionConfig, law: LoadedController) -> None:
    async with standing_vehicle(config) as link:
        link.end.locked = True
        stop = asyncio.Event()
        ground = asyncio.create_task(serve_law(config, law, stop))
        await until(lambda: link.end.status(0.0).refused.startswith("a flight is on"))
        await asyncio.sleep(0.2)
        assert not ground.done()
        link.end.locked = False
        await until(lambda: link.end.status(MonotonicClock().now_s()).connected)
        stop.set()
        await ground


async def test_a_vehicle_that_is_not_there_is_told_with_what_the_network_says(
    config: CompanionConfig, law: LoadedController, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(ground_service, "_MISSED_S", 0.1)
    stop = asyncio.Event()
    caplog.set_level("INFO", "companion")
    ground = asyncio.create_task(serve_law(config, law, stop))
    await until(lambda: "no vehicle answers" in caplog.text)
    assert f"at 127.0.0.1, UDP port {config.law.link.port}: nobody listens there; does `companion serve`" in caplog.text
    async with standing_vehicle(config):
        await until(lambda: "answers again" in caplog.text)
    stop.set()
    await ground


async def test_a_wrong_host_name_is_one_sentence(config: CompanionConfig, law: LoadedController) -> None:
    link = config.law.link.model_copy(update={"host": "no-such-vehicle.invalid"})
    elsewhere = config.model_copy(update={"law": config.law.model_copy(update={"link": link})})
    said = await ends_with(elsewhere, law)
    assert said.startswith("law.link.host = 'no-such-vehicle.invalid': cannot be reached: ")
    assert "\n" not in said


async def test_a_port_that_is_in_use_is_one_sentence(config: CompanionConfig) -> None:
    async with standing_vehicle(config):
        with pytest.raises(ConfigError) as refused:
            async with standing_vehicle(config):
                pass
    said = str(refused.value)
    assert said.startswith(
        f"law.link.port = {config.law.link.port}: cannot listen on 127.0.0.1: Address already in use"
    )
    assert said.endswith("Each needs a port of its own")
    assert "\n" not in said


@pytest.mark.parametrize("listen", ["192.0.2.1", "no-such-name.invalid"])
@pytest.mark.parametrize("run", [asyncio.run, uvloop.run])
def test_an_address_that_is_not_this_computers_is_one_sentence(
    listen: str, run: Callable[[Coroutine[Any, Any, None]], None], config: CompanionConfig
) -> None:
    """192.0.2.1 is nobody's, RFC 5737. The service runs on uvloop, which words its errors otherwise."""
    link = config.law.link.model_copy(update={"listen": listen})
    elsewhere = config.model_copy(update={"law": config.law.model_copy(update={"link": link})})

    async def opened() -> None:
        async with standing_vehicle(elsewhere):
            pass

    with pytest.raises(ConfigError) as refused:
        run(opened())
    said = str(refused.value)
    assert said.startswith(f"law.link.listen = {listen!r}: ")
    assert said.endswith("give an address of this computer, or 0.0.0.0")
    assert "could not bind" not in said
