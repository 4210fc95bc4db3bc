"""`companion status` and `companion watch`: the service's telemetry and events.

Modules that draw are imported only when there is something to draw, so that errors appear at once.
"""

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Annotated, Any

import typer

from companion.cli.operator.exit_codes import INTERRUPTED, code_of
from companion.cli.operator.json_output import end_line, line_of
from companion.cli.operator.options import CommandOptions, with_connection
from companion.client.addresses import endpoints_of, names_several
from companion.client.client import Console, open_console
from companion.client.errors import NoServiceError
from companion.client.messages import Message
from companion.core.errors import CompanionError
from companion.protocol.telemetry import Happened, State


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


@asynccontextmanager
async def _found(options: CommandOptions) -> AsyncIterator[list[Console]]:
    """Yield the vehicles whose services answer; say at once which of several do not, and exit with their code after.

    Raises NoServiceError when the only one does not answer.
    """
    missing: NoServiceError | None = None
    async with AsyncExitStack() as stack:
        found = []
        for endpoint in await endpoints_of(options.endpoint):
            try:
                console = await stack.enter_async_context(open_console(endpoint))
                await console.find()
            except NoServiceError as error:
                if not names_several(options.endpoint):
                    raise
                missing = error
                line = end_line(code_of(error), str(error), endpoint.vehicle)
                typer.echo(line if options.as_json else f"companion: {error}", err=not options.as_json)
            else:
                found.append(console)
        if found:
            yield found
    if missing is not None:
        raise typer.Exit(code_of(missing))


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

    await _for_each(options, print_of)


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
    async with _found(options) as consoles:
        await asyncio.gather(*(work(console) for console in consoles))


async def _show_once(options: CommandOptions) -> None:
    async with _found(options) as consoles:
        from companion.cli.operator.panel import show_once  # noqa: PLC0415 - see above

        show_once(consoles)


async def _show_live(options: CommandOptions) -> None:
    async with _found(options) as consoles:
        from companion.cli.operator.panel import live_panel  # noqa: PLC0415 - see above

        with live_panel(consoles):
            await asyncio.Event().wait()


def _name(options: CommandOptions, console: Console) -> str:
    """Return the name that lines get where several vehicles may be shown; empty where one is."""
    return console.vehicle if names_several(options.endpoint) else ""
