"""What an operator sees while the vehicle flies."""

import math
import queue
import threading
from collections import deque

from rich.console import Console
from rich.live import Live
from rich.text import Text

from companion.arms.machine import ArmPhase
from companion.supervisor.faults import Fault
from companion.supervisor.flight import STREAMING, Phase
from companion.tick import Tick
from companion.types import Array

_REFRESH_HZ = 4.0
_WINDOW = 500
_PATIENCE_S = 2.0


class FlightDisplay:
    """A live line (phase, time, error, update share) on a terminal; one line a phase where there is none.

    All printing is done on a thread of its own: a terminal that is stopped (Ctrl-S, a stalled ssh session) or gone must
    not stop the control loop.
    """

    def __init__(self, console: Console, trajectory: str, controller: str) -> None:
        self._console = console
        self._title = f"{trajectory}, {controller}"
        self._tick: Tick | None = None
        self._phase: Phase | None = None
        self._arms: ArmPhase | None = None
        self._faults: set[Fault] = set()
        self._reason = ""
        self._note = ""
        self._started_s = math.nan
        self._sent: deque[bool] = deque(maxlen=_WINDOW)
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._printer = threading.Thread(target=self._print, name="companion.display", daemon=True)
        self._live = Live(console=console, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._line)

    def __enter__(self) -> "FlightDisplay":
        self._printer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.put(None)
        self._printer.join(_PATIENCE_S)

    def say(self, note: str) -> None:
        """One line above the live one."""
        self._note = note
        self._lines.put(f"  [dim]{note}[/]")

    def _print(self) -> None:
        if self._console.is_terminal:
            self._live.start()
        try:
            while (line := self._lines.get()) is not None:
                self._console.print(line, highlight=False, soft_wrap=True)
        finally:
            self._live.stop()

    def take(self, tick: Tick) -> None:
        """A TickSink: remembers, and announces a new phase."""
        self._tick = tick
        self._sent.append(math.isfinite(tick.sent_s))
        if math.isnan(self._started_s) and tick.flight.phase is Phase.TAKEOFF:
            self._started_s = tick.time_s
        if tick.flight.phase is not self._phase:
            self._phase = tick.flight.phase
            news = tick.flight.reason not in {"", self._reason}
            why = f": {tick.flight.reason}" if news else ""
            self._reason = tick.flight.reason
            self._lines.put(f"{self._clock(tick):>8}  [bold]{self._phase}[/]{why}")
        self._announce_faults(tick)
        if tick.arms is not None and tick.arms.phase is not self._arms:
            self._arms = tick.arms.phase
            if self._arms is ArmPhase.FAULT and tick.arms.reason != self._reason:
                self._lines.put(f"{self._clock(tick):>8}  [red]arms: fault[/]: {tick.arms.reason}")

    def _announce_faults(self, tick: Tick) -> None:
        """Those that are new; one that ended the flight was told with the phase."""
        for event in tick.events:
            if event.fault not in self._faults and tick.flight.phase in STREAMING:
                self._lines.put(f"{self._clock(tick):>8}  [yellow]{event.fault}[/]: {event.text}")
        self._faults = {event.fault for event in tick.events}

    def _clock(self, tick: Tick) -> str:
        return "" if math.isnan(self._started_s) else f"{tick.time_s - self._started_s:.1f} s"

    def _line(self) -> Text:
        tick = self._tick
        if tick is None:
            return Text(self._note)
        parts = [f"{self._title}  {self._clock(tick):>8}  {tick.flight.phase:<9}"]
        if tick.arms is not None:
            parts.append(f"arms {tick.arms.phase:<8}")
        error = _error_w_m(tick)
        if error is not None:
            parts.append("error " + " ".join(f"{100.0 * value:+5.1f}" for value in error) + " cm")
            parts.append(f"updates {sum(self._sent) / len(self._sent):4.0%}")
        return Text("  ".join(parts), no_wrap=True)


def _error_w_m(tick: Tick) -> Array | None:
    if tick.reference is None or tick.vehicle is None:
        return None
    return tick.vehicle.position_w_m - tick.reference.position_w_m
