"""`python -m mock_autopilot`: a simulated PX4 (and its motion capture) for any MAVSDK program."""

import argparse
import asyncio
import contextlib
import os
import re
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.faults.fault import Fault
from mock_autopilot.faults.schedule import FaultTransition
from mock_autopilot.faults.sentences import EXAMPLES, FaultError, parse, sentence_of
from mock_autopilot.fleet.fleet import Collision
from mock_autopilot.impairment.config import impaired
from mock_autopilot.impairment.sentences import parse_directions
from mock_autopilot.impairment.udp_relay import RelayError
from mock_autopilot.mavlink.link import LinkError
from mock_autopilot.qtm.server import ServerStartError
from mock_autopilot.servos.bus import BusStartError
from mock_autopilot.servos.config import Fault as BusFault
from mock_autopilot.simulator import Simulator
from mock_autopilot.world import World

BAD_INPUT = 2
"""Exit code for bad input."""


def main(arguments: list[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; 0 on a clean end, 2 with one sentence on stderr for bad input."""
    options = _parser().parse_args(arguments)
    try:
        config = _configure(options)
        with asyncio.Runner(loop_factory=_fast_loop()) as runner:
            runner.run(_serve(config, options))
    except (MockConfigError, LinkError, ServerStartError, BusStartError, RelayError) as error:
        print(f"mock autopilot: {error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="mock_autopilot", description=__doc__)
    parser.add_argument("--config", type=Path, metavar="FILE", help="TOML file, as config/mock.toml")
    parser.add_argument("--seed", type=_seed, default=1, help="seed of noise and disturbances (default 1)")
    parser.add_argument("--param", action="append", default=[], metavar="NAME=VALUE", help="PX4 parameter, repeatable")
    parser.add_argument("--vehicles", type=int, metavar="N", help="N vehicles in one room (default 1), ports by rule")
    parser.add_argument("--port", type=int, help="UDP port of the client (default 14540)")
    parser.add_argument("--listen", type=int, help="UDP port of the autopilot (default 14580)")
    parser.add_argument("--gcs", action="store_true", help="a second link for a ground station, 18570 to 14550")
    parser.add_argument("--qualisys-port", type=int, help="TCP port of the Qualisys server (default 22223)")
    parser.add_argument("--no-qualisys", action="store_true", help="MAVLink only")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="SENTENCE",
        help=f'fault to inject, such as "{EXAMPLES[0]}"; repeatable',
    )
    parser.add_argument(
        "--impair",
        action="append",
        default=[],
        metavar="WHAT",
        help='bad network: "mavlink loss 10%%", "qtm delay 5 ms", "udp 9000 to 9001 loss 10%%"; repeatable',
    )
    parser.add_argument("--servo-link", metavar="PATH", help="arms' servo bus: link to its pseudo-terminal")
    parser.add_argument("--exit-with-stdin", action="store_true", help="read commands on standard input, end with it")
    return parser


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a seed is a whole number from 0, not {text!r}")
    return int(text)


def _configure(options: argparse.Namespace) -> MockConfig:
    config = MockConfig.load(options.config) if options.config else MockConfig()
    values: dict[str, Any] = config.model_dump()
    for item in options.param:
        name, separator, text = item.partition("=")
        try:
            values["px4"]["params"][name] = float(text)
        except ValueError:
            separator = ""
        if not separator:
            raise MockConfigError(f"--param wants NAME=VALUE with a number, not {item!r}")
    for key, section, option in (
        ("remote_port", "mavlink", options.port),
        ("local_port", "mavlink", options.listen),
        ("port", "qualisys", options.qualisys_port),
        ("vehicles", "fleet", options.vehicles),
    ):
        if option is not None:
            values[section][key] = option
    if options.servo_link is not None:
        values["arms"]["bus"]["link"] = options.servo_link
    values["faults"] = (*values["faults"], *({"say": _checked(sentence)} for sentence in options.fault))
    for text in options.impair:
        try:
            values["impairment"] = impaired(values["impairment"], text)
        except ValueError as error:
            raise MockConfigError(f'--impair "{text}": {error}') from None
    values["gcs"]["enabled"] = values["gcs"]["enabled"] or options.gcs
    return MockConfig.from_dict(values)


def _checked(sentence: str) -> str:
    """Return the sentence; raise MockConfigError with its mistake if it names no fault."""
    try:
        parse(sentence)
    except FaultError as error:
        raise MockConfigError(f'--fault "{sentence}": {error}') from None
    return sentence


def _fast_loop() -> Any:
    """Return uvloop's loop factory where it is installed (ten times less jitter), else None."""
    with contextlib.suppress(ImportError):
        import uvloop  # noqa: PLC0415  # optional

        return uvloop.new_event_loop
    return None


async def _serve(config: MockConfig, options: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    if options.exit_with_stdin:
        os.set_blocking(sys.stdin.fileno(), False)
    async with Simulator(config, options.seed, with_qualisys=not options.no_qualisys) as simulator:
        if options.exit_with_stdin:
            loop.add_reader(sys.stdin.fileno(), _StdinCommands(simulator, stop).read)
        print(_ready_line(simulator, options.seed), flush=True)
        told = _FaultReporter(simulator, config.faults)
        if simulator.fleet is not None:
            simulator.fleet.collision_observers.append(lambda met: _report_collision(simulator, met))
        ended = [
            asyncio.create_task(simulator.wait(), name="mock_autopilot.wait"),
            asyncio.create_task(stop.wait(), name="mock_autopilot.stop"),
        ]
        done, pending = await asyncio.wait(ended, return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        told.never_began()
        for task in done:
            task.result()


class _FaultReporter:
    """Reports on standard output, for the process that started this one, each fault that begins or ends."""

    def __init__(self, simulator: Simulator, faults: Sequence[Fault]) -> None:
        self._simulator, self._waiting = simulator, list(faults)
        for world in simulator.worlds:
            world.faults.observers.append(self._turn)

    def _turn(self, turn: FaultTransition) -> None:
        if turn.begins and turn.fault in self._waiting:
            self._waiting.remove(turn.fault)
        at_s = self._simulator.started_s + turn.time_s  # on this machine's monotonic clock
        what = f"fault {'begins' if turn.begins else 'ends'} at {at_s:.3f} s (monotonic)"
        print(f"{what}: {sentence_of(turn.fault)}", flush=True)

    def never_began(self) -> None:
        """Print the faults that were scheduled and never began."""
        for fault in self._waiting:
            print(f"fault never began: {sentence_of(fault)}", flush=True)


def _report_collision(simulator: Simulator, met: Collision) -> None:
    """Report two bodies that met: to a person, and for the process that started this one."""
    print(f"collision at {simulator.started_s + met.time_s:.3f} s (monotonic): {met}", flush=True)
    print(f"mock autopilot: {met} have collided, their motors have stopped", file=sys.stderr, flush=True)


class _StdinCommands:
    """Commands as lines on standard input, from the process that started this one; its end stops the mock."""

    def __init__(self, simulator: Simulator, stop: asyncio.Event) -> None:
        self._simulator, self._stop = simulator, stop
        self._begun = b""

    def read(self) -> None:
        """Execute complete lines; an unknown command is answered on standard error and changes nothing."""
        data = os.read(sys.stdin.fileno(), 4096)
        if not data:
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
            self._stop.set()
            return
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            try:
                self._execute(line.decode().strip())
            except ValueError as error:
                print(f"mock autopilot: {line.decode(errors='replace')!r}: {error}", file=sys.stderr, flush=True)

    def _execute(self, order: str) -> None:
        """Inject a fault now: `fault mocap stuck for 2 s`, or `servo-fault {"kind": "overload", "id": 6}`.

        Or impair a link: `impair mavlink loss 10%`, `impair qtm delay 5 ms`, `impair network off` (the port pairs).
        Or carry the vehicle: `carry 0.5 0 -0.3` to a position (NED, m), `carry 0 0 0 0 0 1.57` with roll, pitch, yaw.
        In a fleet with the vehicle, as `carry vehicle 2: 0.5 0 -0.3`; `collisions` prints those that have happened.
        """
        word, _, text = order.partition(" ")
        whose, text = _addressed(text)
        if word == "fault":
            self._world(whose).inject(parse(text))
        elif word == "impair":
            part, _, sentence = text.partition(" ")
            self._simulator.impair(part, parse_directions(sentence))
        elif word == "carry":
            numbers = [float(number) for number in text.split()]
            self._world(whose).carry(numbers[:3], numbers[3:] or (0.0, 0.0, 0.0))
        elif word == "collisions":
            fleet = self._simulator.fleet
            print(f"collisions: {', '.join(map(str, fleet.collisions)) or 'none' if fleet else 'none'}", flush=True)
        elif word != "servo-fault":
            raise ValueError(
                "unknown command: use fault SENTENCE (docs/faults.md), impair PART SENTENCE, servo-fault {json}, "
                "carry X Y Z or collisions"
            )
        elif not self._simulator.servo_buses:
            raise ValueError("there are no arms here")
        else:
            self._world(whose)
            self._simulator.servo_buses[whose - 1].inject(BusFault.model_validate_json(text))

    def _world(self, number: int) -> World:
        """Return a vehicle's world; raise ValueError when there is no such vehicle."""
        worlds = self._simulator.worlds
        if not 1 <= number <= len(worlds):
            raise ValueError(f"there is no vehicle {number} here; {len(worlds)} in all")
        return worlds[number - 1]


def _addressed(text: str) -> tuple[int, str]:
    """Split "vehicle 2: rest" into the number and the rest; without a vehicle it is the first one's."""
    whose = re.fullmatch(r"\s*vehicle\s+(\d+)\s*:\s*(.*)", text)
    return (int(whose[1]), whose[2]) if whose else (1, text)


def _ready_line(simulator: Simulator, seed: int) -> str:
    ends = [f"MAVLink udp {link.local_port} -> {link.remote[0]}:{link.remote[1]}" for link in simulator.links]
    if simulator.qualisys is not None:
        ends.append(f"Qualisys tcp {simulator.qualisys.port}")
    ends += [f"servos {bus.path}" for bus in simulator.servo_buses]
    ends += [f"relay {pair}" for pair in simulator.relayed]
    return f"mock autopilot ready: {', '.join(ends)}, seed {seed}"


if __name__ == "__main__":
    sys.exit(main())
