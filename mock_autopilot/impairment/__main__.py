"""`python -m mock_autopilot.impairment`: a bad network between any two programs, on a UDP or TCP port.

The client connects to --listen instead of to the server; the relay passes everything on to --to, and back. Lines on
standard input change the link while it runs: "loss 30%" or "up loss 30%; down clean"; "fault network off for 0.3 s"
does it for a while (docs/faults.md); an empty line prints the counts.
"""

import argparse
import asyncio
import contextlib
import math
import os
import signal
import sys
from collections.abc import Sequence

from mock_autopilot.faults.catalogue import DOWN, UP, Part
from mock_autopilot.faults.network import impairment_of
from mock_autopilot.faults.schedule import ActiveFault
from mock_autopilot.faults.sentences import parse as parse_fault
from mock_autopilot.faults.sentences import sentence_of
from mock_autopilot.impairment.ports import PortPair, Protocol, address
from mock_autopilot.impairment.relays import Relay, open_relays
from mock_autopilot.impairment.sentences import EXAMPLES, Directions, parse_directions
from mock_autopilot.impairment.udp_relay import RelayError

BAD_INPUT = 2
"""Exit code for bad input."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; 0 on a clean end, 2 with one sentence on stderr for bad input."""
    options = _parser().parse_args(arguments)
    try:
        asyncio.run(_serve(_pairs(options), options.seed))
    except (RelayError, ValueError) as error:
        print(f"impairment: {error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mock_autopilot.impairment",
        description=__doc__,
        epilog="SENTENCE is such as " + ", ".join(f'"{one}"' for one in EXAMPLES) + ', "clean", "off".',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--listen", required=True, metavar="[HOST:]PORT", help="where clients connect")
    parser.add_argument("--to", required=True, metavar="[HOST:]PORT", help="the server")
    parser.add_argument("--udp", metavar="SENTENCE", help="pass on UDP over such a link")
    parser.add_argument("--tcp", metavar="SENTENCE", help="pass on TCP, where loss becomes delay")
    parser.add_argument("--seed", type=int, default=1, help="decides what is lost (default 1)")
    return parser


def _pairs(options: argparse.Namespace) -> list[PortPair]:
    """Return the pairs of ports that the options name; raise ValueError with the first mistake."""
    said: dict[Protocol, str | None] = {"udp": options.udp, "tcp": options.tcp}
    listen, to = address(options.listen), address(options.to)
    pairs = [PortPair(one, listen, to, parse_directions(link)) for one, link in said.items() if link is not None]
    if not pairs:
        raise ValueError('give --udp or --tcp a sentence, such as --udp "loss 10%"')
    return pairs


async def _serve(pairs: Sequence[PortPair], seed: int) -> None:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with open_relays(pairs, seed) as relays:
        lines = _Lines(pairs, relays)
        with contextlib.suppress(OSError):  # a file, or nothing, on standard input: no lines to wait for
            loop.add_reader(sys.stdin.fileno(), lines.read)
        for pair, relay in zip(pairs, relays, strict=True):
            listening = PortPair(pair.protocol, (pair.listen[0], relay.port), pair.to)
            print(f"impairment ready: {listening}, {_said(pair.link)}, seed {seed}", flush=True)
        await stop.wait()
        lines.count()


def _said(link: Directions) -> str:
    return str(link.up) if link.up == link.down else f"up {link.up}; down {link.down}"


class _Lines:
    """Lines on standard input: a sentence or a fault changes the link, an empty line asks for the counts."""

    def __init__(self, pairs: Sequence[PortPair], relays: Sequence[Relay]) -> None:
        self._pairs, self._relays = pairs, relays
        self._links = [pair.link for pair in pairs]
        self._held: list[ActiveFault] = []
        self._begun = b""

    def read(self) -> None:
        """Obey complete lines; a sentence with a mistake changes nothing."""
        data = os.read(sys.stdin.fileno(), 4096)
        if not data:
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
            return
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            self._obey(line.decode(errors="replace").strip())

    def _obey(self, line: str) -> None:
        word, _, rest = line.partition(" ")
        try:
            if not line:
                self.count()
            elif word == "fault":
                self._begin(rest)
            else:
                self._links = [parse_directions(line, link) for link in self._links]
                self._set()
        except ValueError as error:
            print(f"impairment: {error}", file=sys.stderr, flush=True)

    def _begin(self, sentence: str) -> None:
        """Begin a fault of the network now, whatever time it names; raise ValueError for another fault."""
        fault = parse_fault(sentence)
        if fault.part is not Part.NETWORK:
            raise ValueError(f'"{sentence}": only faults of the network can be caused here, as "network off for 0.3 s"')
        held = ActiveFault(fault, 0.0)
        self._held.append(held)
        if math.isfinite(fault.lasts_s):
            asyncio.get_running_loop().call_later(fault.lasts_s, self._end, held)
        self._set()

    def _end(self, held: ActiveFault) -> None:
        self._held = [one for one in self._held if one is not held]
        self._set()

    def _set(self) -> None:
        for relay, link in zip(self._relays, self._links, strict=True):
            relay.set(up=impairment_of(self._held, UP, link.up), down=impairment_of(self._held, DOWN, link.down))
        faults = "".join(f", {sentence_of(one.fault)}" for one in self._held)
        print(f"impairment now: {_said(self._links[0])}{faults}", flush=True)

    def count(self) -> None:
        """Print what passed and what was lost so far."""
        for pair, relay in zip(self._pairs, self._relays, strict=True):
            print(f"{pair.protocol} up (to the server): {relay.up_counts}")
            print(f"{pair.protocol} down (to the client): {relay.down_counts}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
