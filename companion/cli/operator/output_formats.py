"""Output of operator commands for people."""

import time
from collections.abc import Callable

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from companion.cli.operator.json_output import Voice
from companion.cli.terminal import show_cursor
from companion.client.messages import Link, Message
from companion.protocol.telemetry import ENDS, Answer, Happened, Kind, Reply, State

Show = Callable[[Reply, Console], None]
"""Function that prints the data of a reply."""
Line = Callable[[], Text]
"""Function that returns a live line as it is now."""
_REFRESH_HZ = 5.0
_ON_THE_WAY = {"goto": ", on the way", "track": ", on the way to the start"}


class LiveLines:
    """Live lines at the end of a terminal, one for each command under way; none where there is no terminal."""

    def __init__(self) -> None:
        self.out = Console(highlight=False, soft_wrap=True)
        """Output that what is printed above the lines goes to."""
        self._lines: list[Line] = []
        self._live: Live | None = None

    @property
    def shown(self) -> bool:
        """True while there are lines on a terminal."""
        return self._live is not None

    def add(self, line: "Line") -> None:
        """Show a line until it is removed."""
        if line not in self._lines:
            self._lines.append(line)
        if self.out.is_terminal and self._live is None:
            self._live = Live(
                console=self.out, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._all
            )
            self._live.start()
            show_cursor(self.out)

    def remove(self, line: "Line") -> None:
        """Take a line away; with the last one the live output ends."""
        if line in self._lines:
            self._lines.remove(line)
        if self._live is not None and not self._lines:
            self._live.stop()
            self._live = None

    def _all(self) -> Group:
        return Group(*(line() for line in self._lines))


class PlainVoice:
    """Output for people: one live line on a terminal, new messages above it."""

    def __init__(self, show: Show | None = None, vehicle: str = "", lines: LiveLines | None = None) -> None:
        """`vehicle`: name before each line, and `lines` of all; none where only one vehicle is commanded."""
        self._show, self._vehicle = show, vehicle
        self._lines = lines or LiveLines()
        self._out = self._lines.out
        self._verb, self._since_s, self._state = "", time.monotonic(), None  # type: str, float, State | None

    def begin(self, verb: str) -> None:
        """Show the live line of `verb` until `end`, on a terminal only."""
        self._verb, self._since_s = verb, time.monotonic()
        self._lines.add(self._line)

    def say(self, message: Message) -> None:
        """Print accepted commands, progress, faults and connection changes."""
        if isinstance(message, State):
            self._state = message
        elif isinstance(message, Link):
            self.note("connected again" if message.there else f"{message.why}; waiting, the command is not sent again")
        elif isinstance(message, Happened) and message.kind is Kind.LOG:
            self.note(message.text)
        elif isinstance(message, Happened) and message.kind in {Kind.FAULT, Kind.FAULT_ENDS}:
            self._print(words_of(message), "yellow" if message.kind is Kind.FAULT else "dim")
        elif isinstance(message, Reply):
            if message.answer in {Answer.ACCEPTED, Answer.PROGRESS} and message.text:
                self._print(message.text, "dim")
            if message.data and self._show is not None and message.answer in ENDS:  # not a list that still fills
                self._lines.remove(self._line)
                if self._vehicle:
                    self._out.print(Text(f"{self._vehicle}:"))
                self._show(message, self._out)

    def note(self, text: str) -> None:
        """Print a sentence above the live line, or on standard error without one."""
        if self._lines.shown:
            self._print(text, "yellow")
        else:
            typer.echo(f"{self._name}{text}", err=True)

    def end(self, code: int, text: str) -> None:
        """Print success on standard output, failure on standard error."""
        self._lines.remove(self._line)
        if self._lines.shown and text:
            self._print(text, "red" if code else "")
        elif code:
            typer.echo(f"companion: {self._name}{text}", err=True)
        elif text:
            typer.echo(f"{self._name}{text}")

    @property
    def _name(self) -> str:
        return f"{self._vehicle}: " if self._vehicle else ""

    def _print(self, text: str, style: str) -> None:
        self._out.print(Text(f"  {self._name}{text}", style=style))

    def _line(self) -> Text:
        parts = [f"  {self._name}{self._verb} {time.monotonic() - self._since_s:.0f} s"]
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


class PlainVoices:
    """Output for people of a command to several vehicles: each line with its vehicle's name."""

    def __init__(self, show: Show | None = None) -> None:
        self._show, self._lines = show, LiveLines()

    def of(self, vehicle: str) -> Voice:
        """Return the output of one vehicle's part."""
        return PlainVoice(self._show, vehicle, self._lines)

    def end(self, code: int, text: str) -> None:
        """Print a failure on standard error; what came of each vehicle was printed at its end."""
        if code:
            typer.echo(f"companion: {text}", err=True)


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
