"""Answers to one client's commands; pure, no sockets."""

import ipaddress
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor

from mock_autopilot.qtm import packets as qtm
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import Component, PacketType

Answer = list[bytes]
"""Packets to send back, often none."""

OLDEST_MINOR = 8
"""The layout of the 6D data is the same from 1.8 on."""
SECTIONS = ("general", "6d")
NO_MORE_DATA = qtm.packet(PacketType.NO_MORE_DATA, b"")


class RefusedError(ValueError):
    """The command is answered by an error packet with this text."""


@dataclass(frozen=True)
class StreamRequest:
    """The contents of one `streamframes` command."""

    components: tuple[Component, ...]
    divisor: int = 1
    frequency_hz: float | None = None
    udp_port: int | None = None
    udp_host: str | None = None
    """None sends to where the command came from."""

    def wants(self, number: int, rate_hz: float) -> bool:
        """Return whether frame `number` belongs to this stream, at `rate_hz` frames per second."""
        if self.frequency_hz is None:
            return number % self.divisor == 0
        share = min(1.0, self.frequency_hz / rate_hz)
        return floor(number * share + 1e-9) > floor((number - 1) * share + 1e-9)


@dataclass
class Session:
    """The state of one client's connection: protocol version and stream."""

    config: QualisysConfig
    version: str = "1.1"
    """QTM's own default until the client sets one."""
    stream: StreamRequest | None = None
    bodies: Callable[[], Sequence[qtm.Body]] | None = None
    """QTM's rigid bodies as its settings are now; None: those of the configuration."""

    def answer(self, command: str, last: qtm.Frame | None, capturing: bool) -> Answer:
        """Return the packets that answer `command`; a wrong one gets an error packet and changes nothing."""
        verb, *rest = command.lower().split() or [""]
        try:
            match verb:
                case "version":
                    answer = self._set_version(rest)
                case "getparameters":
                    answer = self._parameters(rest)
                case "getcurrentframe":
                    answer = _current(rest, last)
                case "streamframes":
                    answer = self._stream(rest, capturing)
                case _:
                    answer = _about(verb, capturing)
        except RefusedError as error:
            return [qtm.text_packet(PacketType.ERROR, str(error))]
        return [answer] if answer else []

    def _set_version(self, words: list[str]) -> bytes:
        if not words:
            return _say(f"Version is {self.version}")
        major, _, minor = words[0].partition(".")
        if major != "1" or not minor.isdecimal() or not OLDEST_MINOR <= int(minor) <= self.config.newest_minor:
            raise RefusedError("Version NOT supported")
        self.version = words[0]
        return _say(f"Version set to {self.version}")

    def _parameters(self, words: list[str]) -> bytes:
        sections = SECTIONS if "all" in words else words
        if not sections or any(section not in SECTIONS for section in sections):
            raise RefusedError("Parse error")
        bodies = self.bodies() if self.bodies is not None else bodies_of(self.config)
        xml = qtm.parameters_xml(sections, bodies, self.config.rate_hz, self.version)
        return qtm.text_packet(PacketType.XML, xml)

    def _stream(self, words: list[str], capturing: bool) -> bytes:
        """Remember the request; the frames are the answer, or 'no more data' while nothing is measured."""
        self.stream = None if words == ["stop"] else parse_stream(words)
        return b"" if capturing or self.stream is None else NO_MORE_DATA


def bodies_of(config: QualisysConfig) -> tuple[qtm.Body, ...]:
    """Return the rigid bodies that QTM has at the start, the vehicle first."""
    return tuple(qtm.Body(name) for name in (config.body, *config.extra_bodies))


def _about(verb: str, capturing: bool) -> bytes:
    match verb:
        case "qtmversion":
            return _say("QTM Version is 2024.3 (build 0, simulated)")
        case "byteorder":
            return _say("Byte order is little endian")
        case "getstate":
            return qtm.event_packet(qtm.Event.CONNECTED if capturing else qtm.Event.CAPTURE_STOPPED)
    raise RefusedError("Parse error")


def parse_stream(words: Sequence[str]) -> StreamRequest:
    """Parse `<frames> [udp:[host:]port] <components>` (lower case); raise RefusedError if it is wrong."""
    if not words:
        raise RefusedError("Parse error")
    divisor, frequency_hz = _pace(words[0])
    udp = [word for word in words[1:] if word.startswith("udp:")]
    host, port = _udp_target(udp[0]) if udp else (None, None)
    components = _components([word for word in words[1:] if not word.startswith("udp:")])
    return StreamRequest(components, divisor, frequency_hz, port, host)


def _pace(word: str) -> tuple[int, float | None]:
    kind, _, number = word.partition(":")
    if word == "allframes":
        return 1, None
    if kind in ("frequency", "frequencydivisor") and number.isdecimal() and int(number) > 0:
        return (1, float(number)) if kind == "frequency" else (int(number), None)
    raise RefusedError("Parse error")


def _udp_target(word: str) -> tuple[str | None, int]:
    host, _, port = word.removeprefix("udp:").rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise RefusedError("Parse error")
    try:
        return (str(ipaddress.ip_address(host)) if host else None), int(port)
    except ValueError as error:
        raise RefusedError("Parse error") from error


def _components(words: Sequence[str]) -> tuple[Component, ...]:
    unknown = [word for word in words if word not in qtm.COMPONENTS]
    if unknown or not words:
        raise RefusedError(f"Component not supported: {' '.join(unknown)}" if unknown else "Parse error")
    return tuple(qtm.COMPONENTS[word] for word in words)


def _current(words: list[str], last: qtm.Frame | None) -> bytes:
    components = _components(words)
    return NO_MORE_DATA if last is None else qtm.data_packet(last, components)


def _say(text: str) -> bytes:
    return qtm.text_packet(PacketType.COMMAND, text)
