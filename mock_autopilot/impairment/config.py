"""Settings of the impairments in the mock; strict, so that a misspelt key is an error."""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mock_autopilot.impairment.ports import PortPair, address
from mock_autopilot.impairment.sentences import parse_directions


def _link(text: str) -> str:
    parse_directions(text)
    return text


def _address(text: str) -> str:
    address(text)
    return text


_Link = Annotated[str, AfterValidator(_link)]
_Address = Annotated[str, AfterValidator(_address)]


class RelayConfig(BaseModel):
    """A port of this machine that passes everything on to another one over an impaired link."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    protocol: Literal["udp", "tcp"] = Field("udp", description="Of both ports.")
    listen: _Address = Field(description='Where clients connect: "PORT" or "HOST:PORT".')
    to: _Address = Field(description='The server: "PORT" or "HOST:PORT".')
    link: _Link = Field("clean", description="A sentence, as mavlink has it.")

    def pair(self) -> PortPair:
        """Return it in the form that relays are opened with."""
        return PortPair(self.protocol, address(self.listen), address(self.to), parse_directions(self.link))


class ImpairmentConfig(BaseModel):
    """Bad networks, docs/mock.md; up is from the client to the server."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mavlink: _Link = Field(
        "clean",
        description='MAVLink (up: to the autopilot): "loss 10% jitter 20 ms", or "up loss 10%; down delay 5 ms".',
    )
    qtm: _Link = Field("clean", description="QTM (down: its frames), over UDP or TCP as the client asked for.")
    relays: tuple[RelayConfig, ...] = Field((), description="Other ports, for the faults of the part network, too.")


_RELAY = re.compile(r"(?P<protocol>udp|tcp)\s+(?P<listen>\S+)\s+to\s+(?P<to>\S+)(?:\s+(?P<link>.*))?", re.DOTALL)
_OWN = re.compile(r"(?P<part>mavlink|qtm)\s+(?P<link>.*)", re.DOTALL)


def impaired(values: dict[str, Any], text: str) -> dict[str, Any]:
    """Return the settings with what `--impair` adds: "mavlink SENTENCE", or "udp 9000 to 9001 SENTENCE".

    Raises ValueError with one sentence.
    """
    relay, own = _RELAY.fullmatch(text.strip()), _OWN.fullmatch(text.strip())
    if own is not None:
        return values | {own["part"]: _link(own["link"])}
    if relay is None:
        raise ValueError(
            'write "mavlink SENTENCE", "qtm SENTENCE", "udp [HOST:]PORT to [HOST:]PORT SENTENCE" or the same with tcp'
        )
    keys = {key: text for key, text in relay.groupdict().items() if text is not None}
    _address(keys["listen"])
    _address(keys["to"])
    _link(keys.get("link", "clean"))
    return values | {"relays": (*values.get("relays", ()), keys)}
