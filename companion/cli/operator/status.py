"""`companion status` and `companion watch`: the service's telemetry and events.

Modules that draw are imported only when there is something to draw, so that errors appear at once.
"""

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Coroutine
from typing import Annotated, Any

import typer

from companion.cli.operator.exit_codes import INTERRUPTED, code_of
from companion.cli.operator.json_output import line_of
from companion.cli.operator.options import CommandOptions, with_connection
from companion.client.client import Console, open_console
from companion.client.endpoint import endpoint_of
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
        typer.echo(json.dumps({"type": "end", "code": code, "text": text}))
    elif text and code != INTERRUPTED:
        typer.echo(f"companion: {text}", err=True)
    raise typer.Exit(code)


async def _heard(console: Console) -> AsyncIterator[Message]:
    """Yield messages for ever; NoServiceError when no service answers."""
    with console.inbox() as inbox:
        await console.find()
        while True:
            message = await inbox.next(None)
            assert message is not None
            yield message


async def _print_states(options: CommandOptions, once: bool) -> None:
    async with open_console(endpoint_of(options.endpoint)) as console:
        async for message in _heard(console):
            if isinstance(message, State) or not (once or isinstance(message, Happened)):
                typer.echo(line_of(message))
            if once and isinstance(message, State):
                return


async def _show_once(options: CommandOptions) -> None:
    async with open_console(endpoint_of(options.endpoint)) as console:
        await console.find()
        from companion.cli.operator.panel import show_once  # noqa: PLC0415 - see above

        show_once(console)


async def _show_live(options: CommandOptions) -> None:
    async with open_console(endpoint_of(options.endpoint)) as console:
        await console.find()
        from companion.cli.operator.panel import live_panel  # noqa: PLC0415 - see above

        with live_panel(console):
            await asyncio.Event().wait()


async def _print_events(options: CommandOptions) -> None:
    async with open_console(endpoint_of(options.endpoint)) as console:
        async for message in _heard(console):
            if isinstance(message, State):
                continue
            if options.as_json:
                typer.echo(line_of(message))
            else:
                from companion.cli.operator.panel import show_event  # noqa: PLC0415 - see above

                show_event(message)
