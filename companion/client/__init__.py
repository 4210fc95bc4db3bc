"""The operator's side of the protocol, and the Python client for scripts: `connect`; docs/python.md.

The names below are the public ones. They are imported when they are used, because command lines start with parts of
this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.client.connecting import (
        connect as connect,
    )
    from companion.client.connecting import (
        connect_all as connect_all,
    )
    from companion.client.connecting import (
        together as together,
    )
    from companion.client.connecting import (
        vehicles as vehicles,
    )
    from companion.client.errors import (
        FailedError as FailedError,
    )
    from companion.client.errors import (
        NoServiceError as NoServiceError,
    )
    from companion.client.errors import (
        RejectedError as RejectedError,
    )
    from companion.client.errors import (
        TimedOutError as TimedOutError,
    )
    from companion.client.errors import (
        UnknownOutcomeError as UnknownOutcomeError,
    )
    from companion.client.errors import (
        VehicleError as VehicleError,
    )
    from companion.client.paths import Curve as Curve
    from companion.client.vehicle import Arms as Arms
    from companion.client.vehicle import Progress as Progress
    from companion.client.vehicle import Vehicle as Vehicle
    from companion.core.errors import CompanionError as CompanionError
    from companion.core.errors import ConfigError as ConfigError
    from companion.protocol.check import Check as Check
    from companion.protocol.telemetry import Happened as Happened
    from companion.protocol.telemetry import Kind as Kind
    from companion.protocol.telemetry import State as State

__all__ = [
    "Arms",
    "Check",
    "CompanionError",
    "ConfigError",
    "Curve",
    "FailedError",
    "Happened",
    "Kind",
    "NoServiceError",
    "Progress",
    "RejectedError",
    "State",
    "TimedOutError",
    "UnknownOutcomeError",
    "Vehicle",
    "VehicleError",
    "connect",
    "connect_all",
    "together",
    "vehicles",
]
_HOMES = (
    "core.errors",
    "client.errors",
    "client.connecting",
    "client.paths",
    "client.vehicle",
    "protocol.check",
    "protocol.telemetry",
)


def __getattr__(name: str) -> object:
    for home in _HOMES if name in __all__ else ():
        module = import_module(f"companion.{home}")
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
