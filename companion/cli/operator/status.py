"""`companion status` and `companion watch`: the service's telemetry and events.

Modules that draw are imported only when there is something to draw, so that errors appear at once.
"""

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import TYPE_CHECKING, Annotated, Any

import typer

from companion.adapters.system.background import first_of
from companion.cli.operator.exit_codes import INTERRUPTED, code_of
from companion.cli.operator.json_output import end_line, line_of
from companion.cli.operator.options import CommandOptions, with_connection
from companion.client.addresses import broker_of_all, endpoints_of, names_several
from companion.client.client import Console, open_console
from companion.client.errors import NoServiceError
from companion.client.messages import Message
from companion.config.operator_config import OperatorConfig
from companion.core.errors import CompanionError
from companion.protocol.telemetry import Happened, State

if TYPE_CHECKING:
    from companion.client.roster import Roster


@with_connection
def status(
    options: CommandOptions,
    once: Annotated[bool, typer.Option("--once", help="Print the state once; the default without a terminal.")] = False,
) -> None:
    """Show phase, position, error, battery, arms and faults, live until Ctrl-C; --json: one object a state."""
    if options.as_json:
        _end(options, _print_states(options, once))
    _end(options, _show_live(options) if sys.stdout.isatty() and not once else _show_once(options))


@with_connection
def watch(options: CommandOptions) -> None:
    """Print phases, faults, commands and replies as they happen, until Ctrl-C."""
    _end(options, _print_events(options))


def _end(options: CommandOptions, work: Coroutine[Any, Any, None]) -> None:
    code, text = 0, ""
    try:
        asyncio.run(work)
    except KeyboardInterrupt:
        code, text = INTERRUPTED, "interrupted"
    except CompanionError as error:
        code, text = code_of(error), str(error)
    if text and options.as_json:
        typer.echo(end_line(code, text))
    elif text and code != INTERRUPTED:
        typer.echo(f"companion: {text}", err=True)
    raise typer.Exit(code)


class _Vehicles:
    """Vehicles of a command line whose services answer; with `all`, those that come later, too."""

    def __init__(self, options: CommandOptions, stack: AsyncExitStack) -> None:
        self._options, self._stack = options, stack
        self._roster: Roster | None = None
        self.consoles: list[Console] = []
        self.missing: NoServiceError | None = None

    async def find(self) -> None:
        """Find those that are there; say at once which of several are not. NoServiceError when the only one is not."""
        for endpoint in await endpoints_of(self._options.endpoint):
            try:
                await self._add(endpoint)
            except NoServiceError as error:
                if not names_several(self._options.endpoint):
                    raise
                self.missing = error
                line = end_line(code_of(error), str(error), endpoint.vehicle)
                as_json = self._options.as_json
                typer.echo(line if as_json else f"companion: {error}", err=not as_json)

    async def next(self) -> Console:
        """Wait for a further vehicle; for ever where they are named."""
        place = broker_of_all(self._options.endpoint)
        if place is None:
            await asyncio.Event().wait()
        assert place is not None
        if self._roster is None:
            from companion.client.roster import open_roster  # noqa: PLC0415 - most command lines name one vehicle

            self._roster = await self._stack.enter_async_context(open_roster(place))
        while True:
            name = await self._roster.next_beside([console.vehicle for console in self.consoles])
            with suppress(NoServiceError):  # it is gone already
                return await self._add(place.model_copy(update={"vehicle": name}))

    async def _add(self, endpoint: OperatorConfig) -> Console:
        async with AsyncExitStack() as trial:
            console = await trial.enter_async_context(open_console(endpoint))
            await console.find()
            self._stack.push_async_exit(trial.pop_all())
        self.consoles.append(console)
        return console


@asynccontextmanager
async def _found(options: CommandOptions) -> AsyncIterator[_Vehicles]:
    """Yield the vehicles; exit with the code of one that is missing after."""
    async with AsyncExitStack() as stack:
        found = _Vehicles(options, stack)
        await found.find()
        if found.consoles:
            yield found
    if found.missing is not None:
        raise typer.Exit(code_of(found.missing))


async def _heard(console: Console) -> AsyncIterator[Message]:
    """Yield messages for ever."""
    with console.inbox() as inbox:
        while True:
            message = await inbox.next(None)
            assert message is not None
            yield message


async def _print_states(options: CommandOptions, once: bool) -> None:
    async def print_of(console: Console) -> None:
        name = _name(options, console)
        async for message in _heard(console):
            if isinstance(message, State) or not (once or isinstance(message, Happened)):
                typer.echo(line_of(message, name))
            if once and isinstance(message, State):
                return

    if not once:
        await _for_each(options, print_of)
        return
    async with _found(options) as found:
        await asyncio.gather(*(print_of(console) for console in found.consoles))


async def _print_events(options: CommandOptions) -> None:
    async def print_of(console: Console) -> None:
        name = _name(options, console)
        async for message in _heard(console):
            if isinstance(message, State):
                continue
            if options.as_json:
                typer.echo(line_of(message, name))
            else:
                from companion.cli.operator.panel import show_event  # noqa: PLC0415 - see above

                show_event(message, name)

    await _for_each(options, print_of)


async def _for_each(options: CommandOptions, work: Callable[[Console], Coroutine[Any, Any, None]]) -> None:
    """Do the work, which does not end, on each vehicle, and on each that comes later."""
    async with _found(options) as found:

        async def further() -> None:
            await first_of(work(await found.next()), further())

        await first_of(*(work(console) for console in found.consoles), further())


async def _show_once(options: CommandOptions) -> None:
    async with _found(options) as found:
        from companion.cli.operator.panel import show_once  # noqa: PLC0415 - see above

        show_once(found.consoles)


async def _show_live(options: CommandOptions) -> None:
    async with _found(options) as found:
        from companion.cli.operator.panel import live_panel  # noqa: PLC0415 - see above

        with live_panel(found.consoles):
            while True:
                await found.next()


def _name(options: CommandOptions, console: Console) -> str:
    """Return the name that lines get where several vehicles may be shown; empty where one is."""
    return console.vehicle if names_several(options.endpoint) else ""
