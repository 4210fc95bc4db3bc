"""Display of a demo flight while the vehicle flies."""

import math
import queue
import threading
import time
from collections import deque

from rich.console import Console
from rich.live import Live
from rich.text import Text

from companion.cli.demo.flight_log import FlightStory
from companion.cli.demo.mock_process import FaultTold
from companion.cli.terminal import show_cursor
from companion.core.types import Array
from companion.flight.tick import Tick
from companion.supervisor.flight_state import Phase

_REFRESH_HZ = 4.0
_WINDOW = 500
_PATIENCE_S = 2.0


class FlightDisplay:
    """Display of new events, with a live line (phase, time, error, update share) below them on a terminal.

    A separate thread prints: a terminal that is stopped (Ctrl-S, a stalled ssh session) or gone must not stop the
    control loop.
    """

    def __init__(self, console: Console, trajectory: str, controller: str) -> None:
        self._console = console
        self._title = f"{trajectory}, {controller}"
        self.story = FlightStory()
        """Log of the flight that is shown."""
        self._doing, self._since_s = "", time.monotonic()
        self._sent: deque[bool] = deque(maxlen=_WINDOW)
        self._lines: queue.SimpleQueue[Text | None] = queue.SimpleQueue()
        self._printer = threading.Thread(target=self._print, name="companion.display", daemon=True)
        self._live = Live(console=console, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._line)

    def __enter__(self) -> "FlightDisplay":
        self._printer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Print what is waiting, and end the live line; more than once does no harm."""
        self._lines.put(None)
        self._printer.join(_PATIENCE_S)

    def say(self, note: str, doing: str = "") -> None:
        """Print a line; the live line shows `doing` (else the note) until the flight begins."""
        self._doing, self._since_s = doing or note, time.monotonic()
        self._lines.put(Text(f"  {note}", style="dim"))

    def say_fault(self, event: FaultTold) -> None:
        """Print a line about an injected fault."""
        head, rest = f"fault {event.turn}", f": {event.sentence}"
        self._lines.put(self.story.line(event.at_s, head, "bold magenta", rest))

    def _print(self) -> None:
        if self._console.is_terminal:
            self._live.start()
            show_cursor(self._console)
        try:
            while (line := self._lines.get()) is not None:
                self._console.print(line, highlight=False, soft_wrap=True)
        finally:
            self._live.stop()

    def take(self, tick: Tick) -> None:
        """Take a tick, as a TickSink, and print its new events."""
        self._sent.append(math.isfinite(tick.sent_s))
        for line in self.story.take(tick):
            self._lines.put(line)

    def _line(self) -> Text:
        tick = self.story.last
        if tick is None or tick.flight.phase is Phase.STANDBY:
            return Text(f"  {self._doing} ({time.monotonic() - self._since_s:.0f} s)", no_wrap=True)
        parts = [f"{self.story.clock(tick.time_s):>8}  {tick.flight.phase:<7}"]
        if tick.arms is not None:
            parts.append(f"arms {tick.arms.phase:<7}")
        error = _error_w_m(tick)
        if error is not None:
            parts.append("error " + " ".join(f"{100.0 * value:+5.1f}" for value in error) + " cm")
            parts.append(f"updates {sum(self._sent) / len(self._sent):4.0%}")
        parts.append(self._title)  # last: where the terminal ends, this may be cut
        return Text("  ".join(parts), no_wrap=True, overflow="ellipsis")


def _error_w_m(tick: Tick) -> Array | None:
    if tick.reference is None or tick.vehicle is None:
        return None
    return tick.vehicle.position_w_m - tick.reference.position_w_m
