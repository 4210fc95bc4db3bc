"""Agreement of ground and vehicle on versions and configuration, checked when they connect. Pure."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from companion.law_link.messages import PROTOCOL, BadMessageError

Agreed = Mapping[str, str | float | int | bool | None]
"""Values that must be equal on both sides, by their keys in the configuration."""
_MOST_NAMED = 3


@dataclass(frozen=True, kw_only=True)
class Introduction:
    """Ground law as it introduces itself."""

    version: str
    law: str
    """Name of the law that it runs."""
    host: str
    """Computer and process, for a person."""
    agreed: Agreed
    protocol: int = PROTOCOL

    def text(self) -> str:
        """Return it as JSON."""
        said = {"protocol": self.protocol, "version": self.version, "law": self.law, "host": self.host}
        return json.dumps(said | {"agreed": dict(self.agreed)}, separators=(",", ":"))


def introduction_of(text: str) -> Introduction:
    """Return the introduction in a hello; raises BadMessageError."""
    try:
        said = json.loads(text)
        return Introduction(
            version=str(said["version"]),
            law=str(said["law"]),
            host=str(said["host"]),
            agreed=dict(said["agreed"]),
            protocol=int(said["protocol"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise BadMessageError(f"a hello that cannot be read: {error}") from error


@dataclass(frozen=True)
class Refusal:
    """Refusal of a ground law by the vehicle."""

    reason: str
    """Sentence for the operator, with what to do."""
    passes: bool = False
    """It ends by itself, with the flight that is on."""

    def text(self) -> str:
        """Return it as JSON."""
        return json.dumps({"reason": self.reason, "passes": self.passes}, separators=(",", ":"))


def refusal_of(text: str) -> Refusal:
    """Return the refusal in a reply; raises BadMessageError."""
    try:
        said = json.loads(text)
        return Refusal(str(said["reason"]), bool(said["passes"]))
    except (ValueError, KeyError, TypeError) as error:
        raise BadMessageError(f"a refusal that cannot be read: {error}") from error


def difference(vehicle: Introduction, ground: Introduction) -> str:
    """Return what differs, and what to do, as a sentence; empty when both agree."""
    if vehicle.protocol != ground.protocol or vehicle.version != ground.version:
        return (
            f"the vehicle runs companion {vehicle.version} (link protocol {vehicle.protocol}), the ground "
            f"{ground.version} ({ground.protocol}): install the same version on both"
        )
    keys = [*vehicle.agreed, *(key for key in ground.agreed if key not in vehicle.agreed)]
    differing = [
        f"{key} is {_shown(vehicle.agreed.get(key))} on the vehicle and {_shown(ground.agreed.get(key))} on the ground"
        for key in keys
        if vehicle.agreed.get(key) != ground.agreed.get(key)
    ]
    if not differing:
        return ""
    more = len(differing) - _MOST_NAMED
    named = ", ".join(differing[:_MOST_NAMED]) + (f", and {more} more" if more > 0 else "")
    return f"{named}: give both the same configuration"


def _shown(value: str | float | int | bool | None) -> str:
    return "not there" if value is None else json.dumps(value)
