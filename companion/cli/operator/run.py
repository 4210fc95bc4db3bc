"""Execution of one operator command, from the options to the exit code."""

import asyncio
import signal
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import typer

from companion.cli.operator.exit_codes import BAD_INPUT, FAILED, INTERRUPTED, code_of
from companion.cli.operator.json_output import JsonVoice, Voice
from companion.cli.operator.options import CommandOptions, with_waiting
from companion.client.client import Console, open_console
from companion.client.command_draft import CommandDraft
from companion.client.endpoint import endpoint_of
from companion.client.pending_command import PendingCommand, Sent
from companion.client.tasks import end
from companion.core.errors import CompanionError
from companion.protocol.telemetry import Answer, Reply

if TYPE_CHECKING:
    from companion.cli.operator.output_formats import Show

_CODES = {Answer.DONE: 0, Answer.ACCEPTED: 0, Answer.FAILED: FAILED, Answer.REFUSED: BAD_INPUT}
_SAFE_S = 15.0
"""Time limit for the command after Ctrl-C; a hold takes a few seconds to stop."""
T = TypeVar("T")

_HOLD, _ABORT = ({"verb": "hold"},), ({"verb": "abort"},)
_AFTER_CTRL_C: dict[str, tuple[dict[str, Any], ...]] = {
    "arm": _ABORT,  # ends the checks before arming, too, which a disarm would not
    "takeoff": (*_HOLD, *_ABORT),  # no hold fits before it has left the ground; then the motors stop
    "goto": _HOLD,
    "track": _HOLD,
    "arms": ({"verb": "arms", "do": "hold"},),
}
"""Commands that make it safe, by verb; the next one is sent when one is refused."""


class _PressedError(Exception):
    """Ctrl-C while the command waits."""


def operate(options: CommandOptions, verb: str, show: "Show | None" = None, **fields: object) -> NoReturn:
    """Send `verb`, wait for its end, and exit with the code that docs/commands.md lists."""
    raise typer.Exit(asyncio.run(_Run(options, _voice_of(options, show)).code(verb, fields)))


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


class _Run:
    def __init__(self, options: CommandOptions, voice: Voice) -> None:
        self._options, self._voice = options, voice
        self._presses: asyncio.Queue[None] = asyncio.Queue()

    async def code(self, verb: str, fields: dict[str, object]) -> int:
        """Run the command, print its end, and return its exit code."""
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self._presses.put_nowait, None)
        try:
            code, text = await self._execute(CommandDraft(verb, **fields))
        except CompanionError as error:
            code, text = code_of(error), str(error)
        self._voice.end(code, text)
        return code

    async def _execute(self, draft: CommandDraft) -> tuple[int, str]:
        async with AsyncExitStack() as stack:
            try:
                opening = stack.enter_async_context(open_console(endpoint_of(self._options.endpoint)))
                console = await self._unless_pressed(opening)
            except _PressedError:
                return INTERRUPTED, "interrupted, nothing was sent"
            pending = PendingCommand(console, draft, self._options.timeout_s)
            self._voice.begin(draft.verb)
            try:
                reply = await self._unless_pressed(self._follow(pending, draft))
            except _PressedError:
                return INTERRUPTED, await self._make_safe(console, pending, draft)
            done = reply.text or str(reply.answer)
            return _CODES[reply.answer], done if reply.answer in _GOOD else reply.sentence(draft.verb)

    async def _follow(self, pending: PendingCommand, draft: CommandDraft) -> Reply:
        """Print the service's messages; return the last reply, or the acceptance with --no-wait."""
        last: Reply | None = None
        async for message in pending.messages():
            self._voice.say(message)
            if isinstance(message, Reply) and message.id == draft.id:
                last = message
                if message.answer is Answer.ACCEPTED and not self._options.wait:
                    break
        assert last is not None
        return last

    async def _make_safe(self, console: Console, pending: PendingCommand, draft: CommandDraft) -> str:
        """Send the commands that make it safe after Ctrl-C; return the sentence about their result."""
        if pending.sent is Sent.NO:
            return "interrupted, nothing was sent"
        remedies = _AFTER_CTRL_C.get(draft.verb, ())
        if not remedies:
            return f"interrupted: {draft.verb} was sent and continues; not waiting for its end"
        outcome = ""
        for remedy in remedies:
            safe = CommandDraft(**remedy)
            what = " ".join(str(value) for value in remedy.values())
            self._voice.note(f"interrupted: {what} is sent; Ctrl-C again leaves without waiting")
            try:
                reply = await self._unless_pressed(self._follow(PendingCommand(console, safe, _SAFE_S), safe))
            except _PressedError:
                return f"interrupted: {what} was sent and continues; not waiting for its end"
            except CompanionError as error:
                return f"interrupted, but it is not known whether {what} was executed: {error}"
            outcome = reply.sentence(what)
            if reply.answer is not Answer.REFUSED:
                break
        return f"interrupted; {outcome}"

    async def _unless_pressed(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result of `work`; cancel it and raise _PressedError when Ctrl-C comes first."""
        doing, pressed = asyncio.ensure_future(work), asyncio.ensure_future(self._presses.get())
        try:
            await asyncio.wait({doing, pressed}, return_when=asyncio.FIRST_COMPLETED)
            if doing.done():
                return doing.result()
            raise _PressedError
        finally:
            await end(doing)
            await end(pressed)


_GOOD = frozenset({Answer.DONE, Answer.ACCEPTED})
