"""Execution of one operator command, from the options to the exit code."""

import asyncio
import signal
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import typer

from companion.cli.operator.exit_codes import INTERRUPTED, code_of
from companion.cli.operator.json_output import JsonVoice, Voice
from companion.cli.operator.options import CommandOptions, with_waiting
from companion.client.addresses import names_several
from companion.client.command_draft import CommandDraft
from companion.client.connecting import open_vehicles
from companion.client.endpoint import endpoint_of
from companion.client.errors import NoServiceError
from companion.client.ownership import REMEDIES
from companion.client.safe_exit import first_accepted
from companion.client.tasks import end
from companion.client.vehicle import Vehicle
from companion.config.operator_config import OperatorConfig
from companion.core.errors import CompanionError

if TYPE_CHECKING:
    from companion.cli.operator.output_formats import Show

T = TypeVar("T")
INTERRUPTED_FIRST = "interrupted, nothing was sent"


class PressedError(Exception):
    """Ctrl-C while the command waits."""


def operate(options: CommandOptions, verb: str, show: "Show | None" = None, **fields: object) -> NoReturn:
    """Send `verb` to one vehicle or several, wait for its end, and exit with the code that docs/commands.md lists."""
    if names_several(options.endpoint):
        from companion.cli.operator.several import run_several  # noqa: PLC0415 - one vehicle starts without it

        raise typer.Exit(asyncio.run(run_several(options, verb, show, fields)))
    raise typer.Exit(asyncio.run(_code(options, verb, _voice_of(options, show), fields)))


def without_arguments(verb: str, about: str, **fields: object) -> Callable[..., None]:
    """Return the command that sends `verb` with these fields; `about` is the text of its --help."""

    def command(options: CommandOptions) -> None:
        operate(options, verb, None, **fields)

    command.__doc__ = about
    return with_waiting(command)


def _voice_of(options: CommandOptions, show: "Show | None") -> Voice:
    if options.as_json:
        return JsonVoice()
    from companion.cli.operator.output_formats import PlainVoice  # noqa: PLC0415 - what draws on a terminal takes its time

    return PlainVoice(show)


async def _code(options: CommandOptions, verb: str, voice: Voice, fields: dict[str, object]) -> int:
    """Run the command on one vehicle, print its end, and return its exit code."""
    run = CommandRun(options, voice)
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, run.press)
    try:
        draft = CommandDraft(verb, **fields)
        async with AsyncExitStack() as stack:
            vehicle = await run.connect(stack, endpoint_of(options.endpoint))
            code, text = await run.execute(vehicle, draft)
    except PressedError:
        code, text = INTERRUPTED, INTERRUPTED_FIRST
    except CompanionError as error:
        code, text = code_of(error), str(error)
        if isinstance(error, NoServiceError):
            text += await _others_online(options)
    voice.end(code, text)
    return code


async def _others_online(options: CommandOptions) -> str:
    from companion.client.roster import others_online  # noqa: PLC0415 - only for a vehicle that is not there

    return await others_online(endpoint_of(options.endpoint))


class CommandRun:
    """One command to one vehicle, which Ctrl-C ends safely."""

    def __init__(self, options: CommandOptions, voice: Voice) -> None:
        self._options, self._voice = options, voice
        self._presses: asyncio.Queue[None] = asyncio.Queue()

    def press(self) -> None:
        """Take a Ctrl-C."""
        self._presses.put_nowait(None)

    async def connect(self, stack: AsyncExitStack, endpoint: OperatorConfig) -> Vehicle:
        """Return the vehicle, connected until `stack` ends; raise PressedError when Ctrl-C comes first."""
        (vehicle,) = await self.unless_pressed(stack.enter_async_context(open_vehicles([endpoint], land=False)))
        return vehicle

    async def execute(self, vehicle: Vehicle, draft: CommandDraft) -> tuple[int, str]:
        """Send the command and wait for its end, made safe after Ctrl-C; return exit code and last sentence."""
        self._voice.begin(draft.verb)
        given = self._options
        try:
            reply = await self.unless_pressed(
                vehicle.execute(draft, timeout_s=given.timeout_s, wait=given.wait, hear=self._voice.say)
            )
        except PressedError:
            return INTERRUPTED, await self._make_safe(vehicle, draft)
        return 0, reply.text or str(reply.answer)

    async def _make_safe(self, vehicle: Vehicle, draft: CommandDraft) -> str:
        """Send the commands that make it safe after Ctrl-C; return the sentence about their result."""
        if not vehicle.own.under_way(draft):
            return INTERRUPTED_FIRST
        remedies = REMEDIES.get(draft.verb, ())
        if not remedies:
            return f"interrupted: {draft.verb} was sent and continues; not waiting for its end"
        what = ""

        def begin(remedy: str) -> None:
            nonlocal what
            what = remedy
            self._voice.note(f"interrupted: {what} is sent; Ctrl-C again leaves without waiting")

        try:
            outcome = await self.unless_pressed(first_accepted(vehicle, remedies, begin, self._voice.say))
        except PressedError:
            return f"interrupted: {what} was sent and continues; not waiting for its end"
        except CompanionError as error:
            return f"interrupted, but it is not known whether {what} was executed: {error}"
        return f"interrupted; {outcome}"

    async def unless_pressed(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of `work`; cancel it and raise PressedError when Ctrl-C comes first."""
        doing, pressed = asyncio.ensure_future(work), asyncio.ensure_future(self._presses.get())
        try:
            await asyncio.wait({doing, pressed}, return_when=asyncio.FIRST_COMPLETED)
            if doing.done():
                return doing.result()
            raise PressedError
        finally:
            await end(doing)
            await end(pressed)
