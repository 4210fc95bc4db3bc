"""The service, the mocks and operators as processes of their own, as they stand in three terminals."""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from companion.cli.demo.mock_process import MockPorts, free_ports
from companion.client.client import open_console
from companion.client.messages import Link, Message
from companion.config.operator_config import OperatorConfig
from companion.protocol.telemetry import Happened, State
from tests.flights.command import ROOT, Ran, Running, mock_config, run, start
from tests.ports import free_port
from tests.warm import mock_process

T = TypeVar("T")
NO_ARMS = ("enabled = true", "enabled = false")
PATIENCE_S = 60.0
"""Far beyond what a step here takes."""
BRISK = """
climb_speed_mps = 1.0
descent_speed_mps = 0.6
spool_up_s = 0.5
settle_s = 0.2
"""
PATIENT = """
# A machine that is shared keeps frames, messages and servos waiting now and then; that is not what is tried here.
[safety]
coast_s = 0.2
degraded_s = 0.3
silent_s = 0.5
delayed_s = 0.3
slow_hz = 5.0
autopilot_silent_s = 2.0
"""

PATIENT_LINK = """command_late_s = 0.2
command_coast_s = 0.25
command_level_s = 0.3
command_silent_s = 0.5
command_delayed_s = 0.25
"""


@dataclass(frozen=True)
class Site:
    """Places of everything: a folder, ports, the service's configuration, and how operators reach it."""

    folder: Path
    ports: MockPorts
    place: OperatorConfig
    """Broker as an operator gives it."""
    served: OperatorConfig
    """Broker as the service has it."""

    @classmethod
    def embedded(cls, folder: Path, ports: MockPorts | None = None) -> "Site":
        """With the service's own broker."""
        port = free_port()
        operators, served = (OperatorConfig(port=port, embedded=embedded) for embedded in (False, True))
        return cls(folder, ports or free_ports(), operators, served)

    @property
    def records(self) -> Path:
        """The folder of the flights' records."""
        return self.folder / "flights"

    def config(self, arms: bool = True, url: str | None = None, law_on_ground: bool = False) -> Path:
        """The demo's file on these ports, brisk, and patient with a busy machine; `url` is the autopilot's."""
        text = (ROOT / "config" / "demo.toml").read_text(encoding="utf-8")
        said, armless = text.split("[arms]")
        for old, new in (
            ("udpin://127.0.0.1:14540", url or f"udpin://127.0.0.1:{self.ports.client}"),
            ("port = 22223", f"port = {self.ports.qualisys}"),
            ("[flight]\n", f"[flight]{BRISK}"),
            ("mocap_hz = 50.0", "mocap_hz = 20.0"),
        ):
            assert old in said, f"config/demo.toml has no {old!r} any more"
            said = said.replace(old, new)
        assert "silent_s = 1.0" in armless, "config/demo.toml's arms are silent after something else now"
        if arms:
            said += f'[arms]\nport = "{self.ports.servo_link}"\nsilent_s = 2.0\n'
        patient = PATIENT + (PATIENT_LINK if law_on_ground else "")
        said += f'{patient}\n[records]\nfolder = "{self.records}"\nlive_port = 0\n\n[operator]\n'
        for name, value in self.served.model_dump(exclude_none=True).items():
            said += f"{name} = {str(value).lower() if isinstance(value, bool | int) else repr(value)}\n"
        said += self._law() if law_on_ground else ""
        path = self.folder / "companion.toml"
        path.write_text(said, encoding="utf-8")
        return path

    def _law(self) -> str:
        """The same tables for both sides of the link, and their key."""
        key = self.folder / "law.key"
        key.write_text("a key for this test alone\n", encoding="utf-8")
        key.chmod(0o600)
        link = f'listen = "127.0.0.1"\nport = {free_port()}\nkey_file = "{key}"\n'
        return f'\n[law]\nruns_on = "ground"\n[law.link]\n{link}'

    def options(self) -> list[str]:
        """For an operator's command."""
        there = self.place
        user = f"{there.user}@" if there.user else ""
        said = ["--broker", f"mqtt{'s' if there.tls else ''}://{user}{there.host}:{there.port}"]
        for option, value in (
            ("--vehicle", f"{there.prefix}/{there.vehicle}"),
            ("--password-file", there.password_file),
            ("--ca-file", there.ca_file),
        ):
            said += [option, value] if value else []
        return said

    async def command(self, *words: str) -> Ran:
        """`companion WORDS`, to its end."""
        return await run(*words, *self.options())

    async def begin(self, *words: str) -> "Underway":
        """The same, and it is not waited for."""
        return Underway(await start(*words, *self.options()))


class Underway:
    """An operator's command that has not ended."""

    def __init__(self, running: Running) -> None:
        self._running = running
        self._ending = asyncio.create_task(running.ended(), name="a command")

    async def meanwhile(self, what: Coroutine[Any, Any, T]) -> T:
        """Await this; fails when the command ends before."""
        doing = asyncio.create_task(what, name="meanwhile")
        await asyncio.wait({doing, self._ending}, return_when=asyncio.FIRST_COMPLETED)
        if not doing.done():
            doing.cancel()
            await asyncio.wait({doing})
            raise AssertionError(f"it ended too soon: {self._ending.result().said}")
        return doing.result()

    def kill(self) -> None:
        """Kill the process as `kill -9` does."""
        self._running.send(signal.SIGKILL)

    async def ended(self) -> Ran:
        """Wait for its end."""
        return await self._ending


class Served:
    """`companion serve`, or another service, in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process, log: Path) -> None:
        self.process, self._log = process, log

    @property
    def log(self) -> str:
        """Return what the service has said so far."""
        return self._log.read_text(encoding="utf-8")

    async def says(self, wanted: str) -> None:
        """Wait until its log has this."""
        await self.until(lambda: wanted in self.log)

    async def until(self, true: Callable[[], bool], story: Callable[[], str] = lambda: "") -> None:
        """Wait for something that has to come while it runs."""
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not true():
                    assert self.process.returncode is None, (
                        f"it ended ({self.process.returncode}):\n{self.log}\n{story()}"
                    )
                    await asyncio.sleep(0.02)
        except TimeoutError:
            raise AssertionError(f"it did not come; so far:\n{self.log}\n{story()}") from None

    async def ended(self) -> int:
        """Its exit code."""
        async with asyncio.timeout(PATIENCE_S):
            return await self.process.wait()

    def broker(self) -> int:
        """The process of its embedded broker."""
        return self._child(b"companion.adapters.broker")

    def writer(self) -> int:
        """The process that writes its records."""
        return self._child(b"companion.records.writer")

    def _child(self, module: bytes) -> int:
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        told = {int(one): Path(f"/proc/{one}/cmdline").read_bytes() for one in children}
        (found,) = [one for one, line in told.items() if module in line]
        return found


@asynccontextmanager
async def serving(config: Path, log: Path, command: str = "serve", **environment: str) -> AsyncIterator[Served]:
    """`companion serve`, or the law on the ground, from its beginning; killed at the end if it still runs."""
    with log.open("wb") as journal:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "companion.cli.main", command, "--config", str(config)),
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **environment},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=journal,
            stderr=journal,
            # As in a terminal of its own: Linux shares a busy computer among sessions, and what begins is busy.
            start_new_session=True,
        )
    try:
        yield Served(process, log)
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


@asynccontextmanager
async def mocks(site: Site, *changes: tuple[str, str]) -> AsyncIterator[None]:
    """Autopilot, motion capture and arms of the demo, with pieces of config/mock.toml replaced."""
    async with mock_process(mock_config(site.folder, *changes), 1, site.ports):
        yield


@dataclass
class Seen:
    """Record of what an observer has seen; the newest state is the last."""

    served: Served
    states: list[State] = field(default_factory=list)
    events: list[Happened] = field(default_factory=list)
    links: list[bool] = field(default_factory=list)

    @property
    def state(self) -> State:
        """The newest."""
        return self.states[-1]

    async def phase(self, *wanted: str) -> State:
        """Wait until the newest state has one of these."""
        await self.served.until(lambda: bool(self.states) and self.state.phase in wanted, self.story)
        return self.state

    async def does(self, verb: str) -> State:
        """Wait until this command is being carried out."""
        await self.served.until(lambda: self.state.doing is not None and self.state.doing.verb == verb, self.story)
        return self.state

    async def lost(self) -> State:
        """Wait until there is no vehicle, or something is wrong with it."""
        await self.served.until(lambda: self.state.phase == "waiting" or bool(self.state.faults), self.story)
        return self.state

    async def well(self) -> State:
        """Wait until the vehicle stands and nothing is wrong."""
        await self.served.until(lambda: self.state.phase == "standby" and not self.state.faults, self.story)
        return self.state

    async def newer(self) -> State:
        """Wait for a state that is said from now on."""
        before = len(self.states)
        await self.served.until(lambda: len(self.states) > before, self.story)
        return self.state

    def story(self) -> str:
        """For a test that fails."""
        return f"{self.states[-1:]}\n" + "\n".join(one.text for one in self.events)


@asynccontextmanager
async def looking_on(place: OperatorConfig, served: Served) -> AsyncIterator[Seen]:
    """An operator's client that only looks, connected again whenever that breaks."""
    seen = Seen(served)

    def hear(said: Message) -> None:
        if isinstance(said, State):
            seen.states.append(said)
        elif isinstance(said, Happened):
            seen.events.append(said)
        elif isinstance(said, Link):
            seen.links.append(said.there)

    async with open_console(place) as console:
        with console.heard_by(hear):
            yield seen


def kill(process: int) -> None:
    """Kill this process as `kill -9` does."""
    os.kill(process, signal.SIGKILL)
