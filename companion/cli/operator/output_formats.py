"""Output of operator commands for people."""

import time
from collections.abc import Callable

import typer
from rich.console import Console
from rich.live import Live
from rich.text import Text

from companion.cli.terminal import show_cursor
from companion.client.messages import Link, Message
from companion.protocol.telemetry import Answer, Happened, Kind, Reply, State

Show = Callable[[Reply, Console], None]
"""Function that prints the data of a reply."""
_REFRESH_HZ = 5.0
_ON_THE_WAY = {"goto": ", on the way", "track": ", on the way to the start"}


class PlainVoice:
    """Output for people: one live line on a terminal, new messages above it."""

    def __init__(self, show: Show | None = None) -> None:
        self._show = show
        self._out = Console(highlight=False, soft_wrap=True)
        self._live: Live | None = None
        self._verb, self._since_s, self._state = "", time.monotonic(), None  # type: str, float, State | None

    def begin(self, verb: str) -> None:
        """Show the live line of `verb` until `end`, on a terminal only."""
        self._verb, self._since_s = verb, time.monotonic()
        if self._out.is_terminal and self._live is None:
            self._live = Live(
                console=self._out, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._line
            )
            self._live.start()
            show_cursor(self._out)

    def say(self, message: Message) -> None:
        """Print accepted commands, progress, faults and connection changes."""
        if isinstance(message, State):
            self._state = message
        elif isinstance(message, Link):
            self.note("connected again" if message.there else f"{message.why}; waiting, the command is not sent again")
        elif isinstance(message, Happened) and message.kind is Kind.LOG:
            self.note(message.text)
        elif isinstance(message, Happened) and message.kind in {Kind.FAULT, Kind.FAULT_ENDS}:
            self._out.print(Text(f"  {words_of(message)}", style="yellow" if message.kind is Kind.FAULT else "dim"))
        elif isinstance(message, Reply):
            if message.answer in {Answer.ACCEPTED, Answer.PROGRESS} and message.text:
                self._out.print(Text(f"  {message.text}", style="dim"))
            if message.data and self._show is not None:
                self._stop()
                self._show(message, self._out)

    def note(self, text: str) -> None:
        """Print a sentence above the live line, or on standard error without one."""
        if self._live is not None:
            self._out.print(Text(f"  {text}", style="yellow"))
        else:
            typer.echo(text, err=True)

    def end(self, code: int, text: str) -> None:
        """Print success on standard output, failure on standard error."""
        self._stop()
        if code:
            typer.echo(f"companion: {text}", err=True)
        elif text:
            typer.echo(text)

    def _stop(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _line(self) -> Text:
        parts = [f"  {self._verb} {time.monotonic() - self._since_s:.0f} s"]
        state = self._state
        if state is not None:
            parts.append(f"phase {phase_of(state)}")
            if state.position_w_m is not None:
                parts.append(f"height {state.position_w_m[2]:.2f} m")
            if state.error_m is not None:
                parts.append(f"error {100.0 * state.error_m:.1f} cm")
            if state.arms is not None:
                parts.append(f"arms {state.arms}")
            if state.doing is not None and state.doing.text:
                parts.append(state.doing.text)
        return Text("   ".join(parts), no_wrap=True, overflow="ellipsis")


def phase_of(state: State) -> str:
    """Return the flight's phase for people; hold on the way to a goal is marked as such."""
    verb = state.doing.verb if state.doing is not None and state.phase == "hold" else ""
    return f"{state.phase}{_ON_THE_WAY.get(verb, '')}"


def words_of(happened: Happened) -> str:
    """Return an event for people, without its time; its kind comes first, as a phase and a verb may share a name."""
    if happened.kind is Kind.FAULT:
        led = f" -> {happened.reaction}" if happened.reaction else ""
        return f"fault: {happened.name}{': ' if happened.name else ''}{happened.text}{led}"
    if happened.kind is Kind.FAULT_ENDS:
        return f"over: {happened.name or happened.text}"
    if happened.kind is Kind.PHASE:
        return f"phase {happened.text}"
    if happened.kind in {Kind.COMMAND, Kind.REPLY} and happened.name:
        return f"{happened.kind} {happened.name}{': ' if happened.text else ''}{happened.text}"
    return happened.text
