"""Vehicle for tests of a script's client: a service that flies as far as its replies and states tell."""

import asyncio
import itertools
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from companion.client import Vehicle
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Doing
from tests.broker import BrokerProcess
from tests.client.scripted import Answers, Script, ScriptedService, scripted

_NUMBER = itertools.count()
_WAITS = frozenset({"goto", "track"})


class Flight:
    """Vehicle that arms, climbs, moves until another command ends that, and lands; a script of the service."""

    def __init__(self) -> None:
        self.begun: defaultdict[str, asyncio.Event] = defaultdict(asyncio.Event)
        """Commands that have come, by their verb."""
        self.lands, self._moves = asyncio.Event(), asyncio.Event()
        self.lands.set()

    async def __call__(self, service: ScriptedService, command: Command) -> Answers:
        self.begun[command.verb].set()
        self._moves.set()
        self._moves = mine = asyncio.Event()
        if command.verb in {"land", "abort"}:  # before the reply, which takes its time to the broker
            service.phase = "land"
        yield Answer.ACCEPTED, f"{command.verb} begins"
        if command.verb in _WAITS:
            service.doing = Doing(id=command.id, verb=command.verb)
            await mine.wait()
            service.doing = None
            yield Answer.FAILED, "ended by another command"
            return
        if command.verb in {"land", "abort"}:
            await self.lands.wait()
            service.armed, service.phase, service.height_m = False, "disarmed", 0.0
        elif command.verb in {"arm", "takeoff"}:
            service.armed, service.phase, service.height_m = True, "hold", 1.0
        yield Answer.DONE, f"{command.verb} is done"


@dataclass(frozen=True)
class Flown:
    """Service of a vehicle, and how a script finds it."""

    service: ScriptedService
    name: str
    broker: str

    @property
    def verbs(self) -> list[str]:
        """Verbs of all commands that have come, in their order."""
        return [one.verb for one in self.service.taken]


@asynccontextmanager
async def flying(there: BrokerProcess, script: Script) -> AsyncIterator[Flown]:
    """Run a service with a vehicle of a new name."""
    name = f"p{next(_NUMBER)}"
    async with scripted(there.port, name, script) as service:
        yield Flown(service, name, f"mqtt://127.0.0.1:{there.port}")


async def moves(vehicle: Vehicle) -> None:
    """Wait until a command is under way."""
    await vehicle.wait_until(lambda state: state.doing is not None, timeout_s=10.0)
