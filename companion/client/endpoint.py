"""Address of the broker and name of the vehicle, from options, a file or the environment."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit

from companion.config.operator_config import OperatorConfig
from companion.config.toml_files import read_toml, validate
from companion.core.errors import ConfigError
from companion.protocol.topics import ALL

BROKER, VEHICLE, PASSWORD_FILE, CA_FILE = (
    "COMPANION_BROKER",
    "COMPANION_VEHICLE",
    "COMPANION_PASSWORD_FILE",
    "COMPANION_CA_FILE",
)
"""Environment variables for values that are not given as options."""
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_URL = "mqtt://HOST, mqtts://USER@HOST:PORT or the like"

_SERVICE_TABLES = frozenset({"mocap", "fence", "room"})
"""Tables that a companion's configuration has and the mock's does not."""


@dataclass(frozen=True)
class EndpointOptions:
    """Options of the command line; None for each that is not given."""

    broker: str | None = None
    vehicle: str | None = None
    password_file: str | None = None
    ca_file: str | None = None
    config: Path | None = None

    @property
    def of_a_broker(self) -> bool:
        """True when options or environment name a broker or a vehicle."""
        return bool(self.broker or self.vehicle or os.environ.get(BROKER) or os.environ.get(VEHICLE))


def endpoint_of(given: EndpointOptions) -> OperatorConfig:
    """Return the endpoint: options override a file's [operator] or else the environment; default is this computer.

    Raises ConfigError with one sentence for an invalid value.
    """
    data: dict[str, Any] = {}
    if given.config is None:
        named = _vehicle if given.vehicle is None else _prefix
        for name, value in ((BROKER, _broker), (VEHICLE, named), (PASSWORD_FILE, _password), (CA_FILE, _ca)):
            data |= value(os.environ[name], name) if os.environ.get(name) else {}
    else:
        data = _table(given.config)
    for option, said, value in (
        ("--broker", given.broker, _broker),
        ("--vehicle", given.vehicle, _vehicle),
        ("--password-file", given.password_file, _password),
        ("--ca-file", given.ca_file, _ca),
    ):
        data |= value(said, option) if said is not None else {}
    return validate(OperatorConfig, data, Path("the broker's options"))


def url_of(endpoint: OperatorConfig) -> str:
    """Return the broker's URL with the user but without a password."""
    user = f"{endpoint.user}@" if endpoint.user else ""
    host = f"[{endpoint.host}]" if ":" in endpoint.host else endpoint.host
    return f"mqtt{'s' if endpoint.tls else ''}://{user}{host}:{endpoint.port}"


def _table(path: Path) -> dict[str, Any]:
    tables = read_toml(path)
    if "operator" not in tables and not _SERVICE_TABLES & tables.keys():
        raise ConfigError(f"{path}: has no table [operator] with the broker's address")
    table = tables.get("operator", {})  # without one the service starts an embedded broker
    return validate(OperatorConfig, table, path, "operator").model_dump(exclude_none=True, exclude={"embedded"})


def _broker(url: str, where: str) -> dict[str, Any]:
    try:
        parts = urlsplit(url if "://" in url else f"mqtt://{url}")
        return _broker_fields(parts, where)
    except ValueError as error:
        raise ConfigError(f"{where} {url!r}: {error}: give {_URL}") from error


def _broker_fields(parts: SplitResult, where: str) -> dict[str, Any]:
    if parts.scheme not in _PORTS:
        raise ValueError(f"scheme {parts.scheme} is not supported")
    if parts.password is not None:
        raise ConfigError(f"{where}: a password in an address is visible to others: give --password-file")
    if not parts.hostname or parts.path not in {"", "/"} or parts.query or parts.fragment:
        raise ValueError("not the address of a broker")
    data: dict[str, Any] = {"host": parts.hostname, "port": parts.port or _PORTS[parts.scheme]}
    data["tls"] = parts.scheme == "mqtts"
    return data | ({"user": parts.username} if parts.username else {})


def _vehicle(name: str, where: str) -> dict[str, Any]:
    if "," in name or name.rpartition("/")[2] == ALL:
        raise ConfigError(f"{where} {name!r}: one vehicle is wanted here, and this names several")
    prefix, slash, vehicle = name.rpartition("/")
    if slash and not prefix:
        raise ConfigError(f"{where} {name!r}: give VEHICLE, or PREFIX/VEHICLE")
    return {"vehicle": vehicle} | ({"prefix": prefix} if prefix else {})


def _prefix(names: str, _: str) -> dict[str, Any]:
    """Return the prefix alone of the environment's vehicles, for a vehicle that is named by an option."""
    prefix = names.partition(",")[0].rpartition("/")[0]
    return {"prefix": prefix} if prefix else {}


def _password(name: str, _: str) -> dict[str, Any]:
    return {"password_file": str(Path(name).expanduser())}


def _ca(name: str, _: str) -> dict[str, Any]:
    return {"ca_file": str(Path(name).expanduser())}
