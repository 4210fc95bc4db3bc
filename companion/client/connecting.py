"""Connections of a script to one vehicle or several; a script that raises leaves none of them in the air."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Generator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from companion.client.addresses import endpoints_of
from companion.client.client import open_console
from companion.client.endpoint import EndpointOptions, endpoint_of
from companion.client.safe_exit import LandOnError, make_safe, warn_of_flight
from companion.client.vehicle import Vehicle
from companion.config.operator_config import OperatorConfig
from companion.protocol.topics import ALL

T = TypeVar("T")


class Connecting:
    """Connection that `async with` opens and closes, or that `await` opens for `close`."""

    def __init__(self, endpoint: OperatorConfig, land_on_error: LandOnError) -> None:
        self.opening = open_vehicles([endpoint], land_on_error)

    async def __aenter__(self) -> Vehicle:
        (vehicle,) = await self.opening.__aenter__()
        return vehicle

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.opening.__aexit__(kind, error, trace)

    def __await__(self) -> Generator[object, None, Vehicle]:
        return self._open().__await__()

    async def _open(self) -> Vehicle:
        vehicle = await self.__aenter__()
        vehicle.on_close = self.opening
        return vehicle


def connect(
    vehicle: str | None = None,
    *,
    broker: str | None = None,
    password_file: str | Path | None = None,
    ca_file: str | Path | None = None,
    config: str | Path | None = None,
    land_on_error: LandOnError = True,
) -> Connecting:
    """Connect to a vehicle's service: `async with connect() as vehicle:`, `with` without asyncio.

    The arguments are the command line's options: what is not given comes from the environment, or else is this
    computer's service. `land_on_error`: what an exception that leaves the block lands: True the flight that this script
    began, "any" every flight, False none. Raises ConfigError, NoServiceError.
    """
    return Connecting(endpoint_of(options_named(vehicle, broker, password_file, ca_file, config)), land_on_error)


@asynccontextmanager
async def connect_all(
    *vehicles: str,
    broker: str | None = None,
    password_file: str | Path | None = None,
    ca_file: str | Path | None = None,
    land_on_error: LandOnError = True,
) -> AsyncIterator[tuple[Vehicle, ...]]:
    """Connect to several vehicles: `async with connect_all("left", "right") as (left, right):`; "all" that are online.

    An exception that leaves the block lands all of them at the same time.
    """
    given = options_named(",".join(vehicles), broker, password_file, ca_file)
    endpoints = await endpoints_of(given) if vehicles else ()
    async with open_vehicles(endpoints, land_on_error) as connected:
        yield connected


async def vehicles(
    *, broker: str | None = None, password_file: str | Path | None = None, ca_file: str | Path | None = None
) -> tuple[str, ...]:
    """Return the names of the vehicles that are online on the broker; NoServiceError when there is none."""
    given = options_named(ALL, broker, password_file, ca_file)
    return tuple(endpoint.vehicle for endpoint in await endpoints_of(given))


async def together(*work: Awaitable[T]) -> list[T]:
    """Return the results of all, in their order; if some fail, wait for the others and raise the errors.

    One error is raised as it is, several as an ExceptionGroup.
    """
    return results_of(await asyncio.gather(*work, return_exceptions=True))


def results_of(outcomes: Sequence[T | BaseException]) -> list[T]:
    """Return results; raise the errors among them."""
    errors = [outcome for outcome in outcomes if isinstance(outcome, BaseException)]
    if len(errors) > 1:
        raise BaseExceptionGroup(f"{len(errors)} of {len(outcomes)} failed", errors)
    if errors:
        raise errors[0]
    return [outcome for outcome in outcomes if not isinstance(outcome, BaseException)]


def options_named(
    vehicle: str | None,
    broker: str | None = None,
    password_file: str | Path | None = None,
    ca_file: str | Path | None = None,
    config: str | Path | None = None,
) -> EndpointOptions:
    """Return the arguments of `connect` as options of the command line."""
    return EndpointOptions(
        broker=broker,
        vehicle=vehicle,
        password_file=None if password_file is None else str(password_file),
        ca_file=None if ca_file is None else str(ca_file),
        config=None if config is None else Path(config),
    )


@asynccontextmanager
async def open_vehicles(endpoints: Sequence[OperatorConfig], land: LandOnError) -> AsyncIterator[tuple[Vehicle, ...]]:
    """Connect to each endpoint's service; make all vehicles safe at the same time when the block raises."""
    async with AsyncExitStack() as stack:
        vehicles = []
        for endpoint in endpoints:
            console = await stack.enter_async_context(open_console(endpoint))
            vehicle = Vehicle(console)
            stack.enter_context(console.heard_by(vehicle.own.hear))
            await console.find()
            vehicles.append(vehicle)
        try:
            yield tuple(vehicles)
        except BaseException as error:
            landing = (make_safe(vehicle, error, land) for vehicle in vehicles)
            results_of(await asyncio.gather(*landing, return_exceptions=True))
            raise
        for vehicle in vehicles:
            warn_of_flight(vehicle)
