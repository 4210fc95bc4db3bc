"""Vehicles found on a real broker, and named by an operator."""

import asyncio

import pytest

from companion.client import ConfigError, NoServiceError, connect_all, sync, vehicles
from companion.client.addresses import endpoints_of, names_several
from companion.client.endpoint import BROKER, VEHICLE, EndpointOptions
from companion.config.operator_config import OperatorConfig
from tests.broker import BrokerProcess, broker
from tests.client.flight import Flight, flying
from tests.client.scripted import scripted
from tests.ports import free_port


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (BROKER, VEHICLE):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.slow
async def test_all_are_those_that_are_online_on_the_broker() -> None:
    with broker() as there:
        url = f"mqtt://127.0.0.1:{there.port}"
        with pytest.raises(NoServiceError, match=f"no vehicle is online at {url} under 'dauam'"):
            await vehicles(broker=url)
        async with flying(there, Flight()) as one, flying(there, Flight()) as two:
            assert await vehicles(broker=url) == (one.name, two.name)
            assert await asyncio.to_thread(sync.vehicles, broker=url) == (one.name, two.name)
            async with scripted(there.port, "left-behind") as third:
                third.silent = True
                await third.present(online=False)  # it goes, and says so
            async with connect_all("all", broker=url) as (left, right):
                assert (left.name, right.name) == (one.name, two.name)


@pytest.mark.slow
async def test_one_that_hangs_is_among_all_and_is_not_passed_over(shared_broker: BrokerProcess) -> None:
    url = f"mqtt://127.0.0.1:{shared_broker.port}"
    async with flying(shared_broker, Flight()) as flown, scripted(shared_broker.port, "hangs") as service:
        service.silent = True
        assert {flown.name, "hangs"} <= set(await vehicles(broker=url))
        with pytest.raises(NoServiceError, match=r"that of 'hangs' at .* was there, but has sent nothing for 2 s"):
            async with connect_all(flown.name, "hangs", broker=url):
                pass
        await service.present(online=False)


async def test_without_a_broker_one_sentence() -> None:
    with pytest.raises(NoServiceError, match=r"no broker at mqtt://127\.0\.0\.1"):
        await vehicles(broker=f"mqtt://127.0.0.1:{free_port()}")


@pytest.mark.parametrize(
    ("given", "roots"),
    [
        ("a,b", ("dauam/v1/a", "dauam/v1/b")),
        ("lab/a, b", ("lab/v1/a", "lab/v1/b")),
        ("lab/a,yard/b", ("lab/v1/a", "yard/v1/b")),
        ("a", ("dauam/v1/a",)),
    ],
)
async def test_names_stand_between_commas_and_the_first_prefix_counts(given: str, roots: tuple[str, ...]) -> None:
    found = await endpoints_of(EndpointOptions(vehicle=given))
    assert tuple(endpoint.topics.root for endpoint in found) == roots


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("a,,b", r"--vehicle 'a,,b': give each vehicle's name once, as in A,B"),
        ("a,a", r"--vehicle 'a,a': give each vehicle's name once"),
        ("a,all", r"--vehicle 'a,all': all is every vehicle: give it alone"),
        ("a,b c", r"vehicle = 'b c': must be 1 to 32 letters"),
    ],
)
async def test_names_that_cannot_be_are_one_sentence(given: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        await endpoints_of(EndpointOptions(vehicle=given))


def test_the_environment_names_several_vehicles_as_the_option_does(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not names_several(EndpointOptions())
    monkeypatch.setenv(VEHICLE, "lab/all")
    assert names_several(EndpointOptions())
    assert not names_several(EndpointOptions(vehicle="a"))
    assert names_several(EndpointOptions(vehicle="a,b"))


def test_no_vehicle_is_called_all() -> None:
    with pytest.raises(ValueError, match="means every vehicle that is online"):
        OperatorConfig(vehicle="all")
