"""Lines about each vehicle of a demo; on a terminal with a live line below them."""

import itertools
import math
import time
from collections.abc import Sequence

from rich.console import Console
from rich.live import Live
from rich.text import Text

from companion.cli.demo.mock_process import FaultTold
from companion.cli.operator.output_formats import words_of
from companion.cli.terminal import show_cursor
from companion.client.vehicle import Vehicle
from companion.protocol.telemetry import Happened, Kind, State
from companion.supervisor.faults import FailsafeAction

_REFRESH_HZ = 4.0
_STYLES = {Kind.FAULT: "yellow", Kind.FAULT_ENDS: "dim", Kind.PHASE: "bold"}
_TOLD_REPLIES = ("refused", "failed")


class FleetDisplay:
    """Lines on a console; times count from the beginning of the display."""

    def __init__(self, console: Console) -> None:
        self._console, self._begun_s = console, time.monotonic()
        self._vehicles: Sequence[Vehicle] = ()
        self._warned: set[tuple[str, str]] = set()
        """Vehicles and faults that were shown as a warning, which is enough."""
        self._refused: dict[str, str] = {}
        """Newest reply of each vehicle: verb and answer."""
        self._live = Live(console=console, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._line)

    def follow(self, vehicles: Sequence[Vehicle]) -> None:
        """Show these vehicles in the live line from now on."""
        self._vehicles = vehicles

    def __enter__(self) -> "FleetDisplay":
        if self._console.is_terminal:
            self._live.start()
            show_cursor(self._console)
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def say(self, text: str) -> None:
        """Print a step of the demo."""
        self._print("", text, "cyan")

    def tell(self, vehicle: str, happened: Happened) -> None:
        """Print an event of one vehicle, if it is one to watch."""
        if happened.kind is Kind.COMMAND or not self._is_news(vehicle, happened):
            return
        self._print(vehicle, words_of(happened), _STYLES.get(happened.kind, ""))

    def _is_news(self, vehicle: str, happened: Happened) -> bool:
        """Return False for replies of commands that go well, and for a refusal or a warning that is only repeated."""
        fault = (vehicle, happened.name)
        if happened.kind is Kind.FAULT_ENDS:
            return fault not in self._warned
        if happened.kind is Kind.FAULT:
            new = fault not in self._warned
            if happened.reaction == FailsafeAction.WARN.words:
                self._warned.add(fault)
                return new
            self._warned.discard(fault)
            return True
        if happened.kind is not Kind.REPLY:
            return True
        begun = happened.name.partition(" ")[2] not in _TOLD_REPLIES
        repeated = self._refused.get(vehicle) == happened.name
        self._refused[vehicle] = happened.name
        return not begun and not repeated

    def tell_of_mocks(self, told: FaultTold) -> None:
        """Print a notice of the mocks."""
        self._print("mocks", f"{told.turn}: {told.sentence}", "bold magenta")

    def _print(self, who: str, text: str, style: str) -> None:
        line = Text(f"{time.monotonic() - self._begun_s:7.1f} s  ", style="dim")
        line.append(f"{who:<8} " if who else "", style="bold").append(text, style=style)
        self._console.print(line, highlight=False, soft_wrap=True)

    def _line(self) -> Text:
        states = [(vehicle.name, vehicle.state) for vehicle in self._vehicles]
        parts = [f"{name} {_words(state)}" for name, state in states]
        places = [state.position_w_m for _, state in states if state.position_w_m is not None]
        pairs = [math.dist(one[:2], other[:2]) for one, other in itertools.combinations(places, 2)]
        if pairs:
            parts.append(f"apart {min(pairs):.2f} m")
        return Text("  " + "   ".join(parts), no_wrap=True, overflow="ellipsis")


def _words(state: State) -> str:
    error = "" if state.error_m is None else f" {100.0 * state.error_m:.1f} cm"
    return f"{state.phase}{error}"
