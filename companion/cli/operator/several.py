"""Execution of one operator command on several vehicles, together or one after the other."""

import asyncio
import signal
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

from companion.cli.operator.exit_codes import BAD_INPUT, INTERRUPTED, NOBODY, code_of, worst
from companion.cli.operator.json_output import JsonVoices, Voice, Voices
from companion.cli.operator.options import CommandOptions
from companion.cli.operator.run import INTERRUPTED_FIRST, CommandRun, PressedError
from companion.client.addresses import endpoints_of
from companion.client.command_draft import CommandDraft, stops
from companion.client.vehicle import Vehicle
from companion.config.operator_config import OperatorConfig
from companion.core.errors import CompanionError, ConfigError

if TYPE_CHECKING:
    from companion.cli.operator.output_formats import Show

_TOGETHER = frozenset({"preflight", "params"})
"""Verbs that, like those that stop, go to all at the same time unless the operator says otherwise."""
_LEAD_ASTRAY = frozenset({"goto", "track"})


@dataclass
class _Part:
    """One vehicle's part in a command to several."""

    endpoint: OperatorConfig
    run: CommandRun
    voice: Voice
    draft: CommandDraft
    vehicle: Vehicle | None = None
    code: int | None = None
    """Exit code; None until it has ended."""

    @property
    def name(self) -> str:
        """Name of the vehicle."""
        return self.endpoint.vehicle

    def end(self, code: int, text: str) -> None:
        """Print its end."""
        self.code = code
        self.voice.end(code, text)


async def run_several(options: CommandOptions, verb: str, show: "Show | None", fields: dict[str, object]) -> int:
    """Run the command on all vehicles that the options name, print each one's end, and return the worst exit code."""
    voices = _voices_of(options, show)
    try:
        if verb in _LEAD_ASTRAY:
            raise ConfigError(
                f"{verb} would lead several vehicles to the same place: name one vehicle, or give each its own in a "
                "script (docs/several-vehicles.md)"
            )
        CommandDraft(verb, **fields)
        return await _Several(options, voices, verb, fields).code()
    except PressedError:
        code, text = INTERRUPTED, INTERRUPTED_FIRST
    except CompanionError as error:
        code, text = code_of(error), str(error)
    voices.end(code, text)
    return code


def _voices_of(options: CommandOptions, show: "Show | None") -> Voices:
    if options.as_json:
        return JsonVoices()
    from companion.cli.operator.output_formats import PlainVoices  # noqa: PLC0415 - as for one vehicle

    return PlainVoices(show)


class _Several:
    def __init__(self, options: CommandOptions, voices: Voices, verb: str, fields: dict[str, object]) -> None:
        self._options, self._voices, self._verb, self._fields = options, voices, verb, fields
        self._parts: list[_Part] = []
        self._stops = stops(verb, fields)
        together = options.together
        self._together = (verb in _TOGETHER or self._stops) if together is None else together

    async def code(self) -> int:
        """Run it; raises CompanionError and PressedError before there are vehicles."""
        first = CommandRun(self._options, self._voices.of(""))

        def press() -> None:
            first.press()
            for part in self._parts:
                part.run.press()

        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, press)
        endpoints = await first.unless_pressed(endpoints_of(self._options.endpoint))
        self._parts = [self._part(endpoint) for endpoint in endpoints]
        async with AsyncExitStack() as stack:
            if self._stops and self._together:  # none waits for one that is not there
                await asyncio.gather(*(self._connect_and_execute(part, stack) for part in self._parts))
            else:
                await asyncio.gather(*(self._connect(part, stack) for part in self._parts))
                self._require_all()
                await self._execute([part for part in self._parts if part.code is None])
        codes = [part.code or 0 for part in self._parts]
        done = sum(code == 0 for code in codes)
        self._voices.end(worst(codes), f"{self._verb}: {done} of {len(codes)} vehicles")
        return worst(codes)

    def _part(self, endpoint: OperatorConfig) -> _Part:
        voice = self._voices.of(endpoint.vehicle)
        draft = CommandDraft(self._verb, **self._fields)
        return _Part(endpoint, CommandRun(self._options, voice), voice, draft)

    async def _connect_and_execute(self, part: _Part, stack: AsyncExitStack) -> None:
        await self._connect(part, stack)
        if part.vehicle is not None:
            await self._execute_one(part)

    async def _connect(self, part: _Part, stack: AsyncExitStack) -> None:
        try:
            part.vehicle = await part.run.connect(stack, part.endpoint)
        except PressedError:
            part.end(INTERRUPTED, INTERRUPTED_FIRST)
        except CompanionError as error:
            part.end(code_of(error), str(error))

    def _require_all(self) -> None:
        """End every part when one vehicle is not reached, unless the command makes safe: then the others get it."""
        missing = [part.name for part in self._parts if part.vehicle is None]
        if self._stops or not missing:
            return
        for part in self._parts:
            if part.code is None:
                part.end(NOBODY, f"{self._verb} was not sent, because {' and '.join(missing)} cannot be reached")

    async def _execute(self, parts: Sequence[_Part]) -> None:
        if self._together:
            await asyncio.gather(*(self._execute_one(part) for part in parts))
            return
        failed = ""
        for part in parts:
            if failed:
                part.end(BAD_INPUT, f"{self._verb} was not sent, because it has not succeeded on {failed}")
                continue
            await self._execute_one(part)
            failed = part.name if part.code else ""

    async def _execute_one(self, part: _Part) -> None:
        assert part.vehicle is not None
        try:
            code, text = await part.run.execute(part.vehicle, part.draft)
        except CompanionError as error:
            code, text = code_of(error), str(error)
        part.end(code, text)
