"""Law on the ground for the duration of a demo: its process, a key, and a relay that impairs the link."""

import asyncio
import json
import logging
import secrets
import sys
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.adapters.system import child_process
from companion.cli.demo.mock_process import MockError, free_udp_ports
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.flight_config import LawConfig, LawLinkConfig

_STOP_S = 5.0


def of_network(fault: str) -> bool:
    """Return whether a sentence is a fault of the network between vehicle and ground (docs/faults.md)."""
    return fault.lower().split()[:1] == ["network"]


class Radio:
    """The relay between vehicle and ground, as far as faults concern it."""

    def __init__(self) -> None:
        self._relay: asyncio.StreamWriter | None = None
        self._begun: list[str] = []

    def begin(self, fault: str) -> None:
        """Cause a fault of the network from now on, or as soon as there is a relay; other faults are not its own."""
        if not of_network(fault):
            return
        if self._relay is None:
            self._begun.append(fault)
        else:
            self._relay.write(f"fault {fault}\n".encode())

    def open(self, relay: asyncio.StreamWriter) -> None:
        """Take the relay's standard input."""
        self._relay, begun = relay, self._begun
        for fault in begun:
            self.begin(fault)


@dataclass(frozen=True)
class Ground:
    """Options of a law on the ground."""

    onboard_mocap: bool = True
    link: str | None = None
    """Impairment of the link, in the words of `python -m mock_autopilot.impairment`; None: no relay."""
    record: str = ""
    """Name of the ground's record, a part of the file's name; without one nothing is recorded."""
    folder: Path = Path("flights")
    """Folder of that record."""


def newest_record(folder: Path, name: str) -> Path | None:
    """Return the newest record of a law on the ground with this name; None without one."""
    found = sorted(folder.glob(f"*-{name}-ground-*.mcap"), key=lambda path: path.stat().st_mtime)
    return found[-1] if found else None


@asynccontextmanager
async def law_on_ground(
    config: CompanionConfig, law: LoadedController, ground: Ground, seed: int, radio: Radio
) -> AsyncIterator[CompanionConfig]:
    """Run the law in a process of its own; yield the vehicle's configuration; MockError for a wrong impairment."""
    vehicle_port, relay_port = free_udp_ports(2)
    with _key_file() as key:
        ends = LawLinkConfig(port=vehicle_port, listen="127.0.0.1", key_file=str(key))
        split = config.model_copy(
            update={"law": LawConfig(runs_on="ground", onboard_mocap=ground.onboard_mocap, link=ends)}
        )
        async with (
            _relay(ground.link, (relay_port, vehicle_port), seed, radio) as port,
            _ground_process(split, law, port, ground),
        ):
            yield split


@contextmanager
def _key_file() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="dauam-law-") as folder:
        key = Path(folder) / "key"
        key.touch(mode=0o600)
        key.write_text(secrets.token_hex(32) + "\n", encoding="ascii")
        yield key


@asynccontextmanager
async def _relay(link: str | None, ports: tuple[int, int], seed: int, radio: Radio) -> AsyncIterator[int]:
    """Yield the port by which the ground reaches the vehicle's; `ports` are the relay's own and the vehicle's."""
    listen, to = ports
    if link is None:
        yield to
        return
    options = ["--udp", link, "--listen", str(listen), "--to", f"127.0.0.1:{to}", "--seed", str(seed)]
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "mock_autopilot.impairment", *options),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdin is not None
        if not await process.stdout.readline():
            said = (await process.stderr.read()).decode(errors="replace").strip()
            raise MockError(f"--link {link!r}: {said.partition(': ')[2] or said}")
        radio.open(process.stdin)
        yield listen
    finally:
        process.terminate()
        await child_process.end(process, _STOP_S)


@asynccontextmanager
async def _ground_process(
    config: CompanionConfig, law: LoadedController, port: int, ground: Ground
) -> AsyncIterator[None]:
    link = config.law.link.model_copy(update={"port": port})
    records = config.records.model_copy(update={"folder": str(ground.folder), "live_port": 0})
    split = config.model_copy(update={"law": config.law.model_copy(update={"link": link}), "records": records})
    settings = {
        "config": split.model_dump(mode="json"),
        "record": ground.record,
        "controller": law.name,
        "allow_unstable": law.unstable_allowed,
        "level": logging.INFO if logging.getLogger("companion").isEnabledFor(logging.DEBUG) else logging.CRITICAL,
    }
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "companion.ground"), stdin=asyncio.subprocess.PIPE, start_new_session=True
    )
    try:
        assert process.stdin is not None
        process.stdin.write(json.dumps(settings).encode() + b"\n")
        await process.stdin.drain()
        yield
    finally:
        await child_process.end(process, _STOP_S)
