"""A pair of ports with an impaired link between them, as the console and the mock's configuration name it; pure."""

import re
from dataclasses import dataclass, field
from typing import Literal

from mock_autopilot.impairment.sentences import Directions

Address = tuple[str, int]
"""Host and port."""
Protocol = Literal["udp", "tcp"]
_ADDRESS = re.compile(r"(?:(?P<host>[^\s:\[\]]+|\[[0-9a-fA-F:.]+\]):)?(?P<port>\d{1,5})")


@dataclass(frozen=True)
class PortPair:
    """A port that passes everything on to another one."""

    protocol: Protocol
    listen: Address
    to: Address
    link: Directions = field(default_factory=Directions)

    def __str__(self) -> str:
        (here, port), (host, to) = self.listen, self.to
        return f"{self.protocol} {here}:{port} -> {host}:{to}"


def address(text: str) -> Address:
    """Return "HOST:PORT" or "PORT" (of this machine) as host and port; raise ValueError with one sentence."""
    match = _ADDRESS.fullmatch(text.strip())
    if match is None or int(match["port"]) > 65535:
        raise ValueError(f'"{text}" is no address: write HOST:PORT, or PORT alone for this machine')
    return (match["host"] or "127.0.0.1").strip("[]"), int(match["port"])
