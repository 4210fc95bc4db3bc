"""Vehicles that an operator names at once: `A,B`, or `all` that are online on a broker."""

import os
from dataclasses import replace

from companion.client.endpoint import VEHICLE, EndpointOptions, endpoint_of
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError
from companion.protocol.topics import ALL


def names_several(given: EndpointOptions) -> bool:
    """Return whether options or environment name vehicles by a list or by `all`, be it only one."""
    words = _words(given)
    return len(words) > 1 or (bool(words) and words[0].rpartition("/")[2] == ALL)


def broker_of_all(given: EndpointOptions) -> OperatorConfig | None:
    """Return the place where vehicles are looked for when they are named by `all`; None when they are not.

    Raises ConfigError for a prefix that cannot be.
    """
    words = _words(given)
    if len(words) != 1 or words[0].rpartition("/")[2] != ALL:
        return None
    return endpoint_of(replace(given, vehicle=f"{words[0].removesuffix(ALL)}unnamed"))


async def endpoints_of(given: EndpointOptions) -> tuple[OperatorConfig, ...]:
    """Return the endpoint of each vehicle; for `all` ask the broker.

    The first name's prefix counts for those without one. Raises ConfigError for names that cannot be, NoServiceError
    when `all` are none.
    """
    words, place = _words(given), broker_of_all(given)
    if place is not None:
        return await _online(place)
    if not names_several(given):
        return (endpoint_of(given),)
    prefix = "".join(words[0].rpartition("/")[:2])
    names = [word.removeprefix(prefix) for word in words]
    if ALL in names:
        raise ConfigError(f"--vehicle {','.join(words)!r}: all is every vehicle: give it alone")
    for name in names:
        if not name or names.count(name) > 1:
            raise ConfigError(f"--vehicle {','.join(words)!r}: give each vehicle's name once, as in A,B")
    full = [name if "/" in name else f"{prefix}{name}" for name in names]
    return tuple(endpoint_of(replace(given, vehicle=name)) for name in full)


async def _online(place: OperatorConfig) -> tuple[OperatorConfig, ...]:
    from companion.client.roster import vehicles_at  # noqa: PLC0415 - most command lines name one vehicle

    return tuple(place.model_copy(update={"vehicle": name}) for name in await vehicles_at(place))


def _words(given: EndpointOptions) -> tuple[str, ...]:
    """Return the names in the order given; none where a file or the default names the vehicle."""
    said = given.vehicle
    if said is None and given.config is None:
        said = os.environ.get(VEHICLE)
    return tuple(word.strip() for word in said.split(",")) if said else ()
