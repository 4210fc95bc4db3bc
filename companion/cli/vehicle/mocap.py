"""`companion mocap`: motion capture alone, without an autopilot."""

import asyncio
import contextlib
import math
import signal
from collections import deque
from typing import Annotated

import typer
import uvloop
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import VehicleConfigFile, vehicle_settings
from companion.cli.terminal import show_cursor
from companion.cli.vehicle.preflight import show
from companion.config.companion_config import CompanionConfig
from companion.estimation.estimator import age_s
from companion.geometry.frames import up_axis, yaw_of
from companion.preflight.checks.all_checks import check_mocap
from companion.preflight.checks.check import Check
from companion.preflight.checks.mocap import MocapWatch
from companion.preflight.live_observer import LiveObserver, mocap_place, open_mocap_observer

_REFRESH_HZ = 4.0
_RATE_S = 2.0
"""Window over which the frame rate is counted."""
_WITHOUT_TERMINAL_S = 5.0


def mocap(
    config: VehicleConfigFile = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=1.0, max=3600.0, metavar="S", help="Duration, s.  [default: until Ctrl-C; 5 without a terminal]"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Show position and heading of the vehicle's body, live, with rate, age and residual of motion capture.

    Needs neither autopilot nor servos, and sends nothing. Carry the vehicle: the position follows your hand, z grows
    when you lift it, the heading grows when you turn it to the left.

    Exit codes: 0 good enough for a flight, 1 not so, 2 could not be started, 130 after Ctrl-C before the first frame;
    later, Ctrl-C ends the display and prints the checks.
    """
    settings = vehicle_settings(config)
    console = Console(stderr=as_json)
    if seconds is None and not console.is_terminal:
        seconds = _WITHOUT_TERMINAL_S
    try:
        checks = uvloop.run(_look(settings, math.inf if seconds is None else seconds, console))
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/] before the first frame")
        raise typer.Exit(INTERRUPTED) from None
    show(checks, console, as_json, "motion capture is good enough for a flight", "fail: not good enough for a flight")
    raise typer.Exit(FAILED if any(check.refuses for check in checks) else 0)


async def _look(config: CompanionConfig, for_s: float, console: Console) -> tuple[Check, ...]:
    """Observe for `for_s` or until Ctrl-C; return the checks."""
    loop, pressed = asyncio.get_running_loop(), asyncio.Event()
    with console.status(Text(f"connecting to motion capture {mocap_place(config)}")) as waiting:
        show_cursor(console)
        async with open_mocap_observer(config) as (observer, watch):
            waiting.stop()
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                loop.add_signal_handler(number, pressed.set)
            shown = _Shown(config.mocap.body, observer, watch)
            observer.each = shown
            until = "until Ctrl-C" if math.isinf(for_s) else f"for {for_s:g} s"
            console.print(f"looking at motion capture {mocap_place(config)} {until}", highlight=False, markup=False)
            begun_s = loop.time()
            with Live(console=console, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=shown.table):
                show_cursor(console)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(pressed.wait(), None if math.isinf(for_s) else for_s)
            seen = watch.seen(config.mocap.body, loop.time() - begun_s)
    console.print(shown.table())
    return check_mocap(seen, config.safety, config.preflight)


class _Shown:
    """Live table, updated once a cycle as the observer's `each`."""

    def __init__(self, body: str, observer: LiveObserver, watch: MocapWatch) -> None:
        self._body, self._observer, self._watch = body, observer, watch
        self._now_s = math.nan
        self._arrivals_s: deque[float] = deque()

    def __call__(self, now_s: float, received_s: float) -> None:
        self._watch.look(now_s)
        self._now_s = now_s
        if not math.isnan(received_s):
            self._arrivals_s.append(received_s)
        while self._arrivals_s and self._arrivals_s[0] < now_s - _RATE_S:
            self._arrivals_s.popleft()

    def table(self) -> Table:
        """Return a table with stream, body, position, heading and residual."""
        table = Table(box=None, pad_edge=False, show_header=False)
        for name, value in (("frames", self._stream()), ("body", self._tracked()), *self._pose()):
            table.add_row(Text(name, style="dim"), Text(value))
        return table

    def _stream(self) -> str:
        frame = self._observer.frame
        late = f", {frame.late} dropped because they came late" if frame is not None and frame.late else ""
        return f"{len(self._arrivals_s) / _RATE_S:.0f} Hz, {self._watch.frames} so far{late}"

    def _tracked(self) -> str:
        missed = self._watch.frames - self._watch.tracked
        frame = self._observer.frame
        now = "is seen" if frame is not None and frame.tracked else "is NOT SEEN now"
        return f"{self._body!r} {now}; missed in {missed} of {self._watch.frames} frames"

    def _pose(self) -> list[tuple[str, str]]:
        estimate, frame = self._observer.estimate, self._observer.frame
        if estimate.vehicle is None or frame is None:
            return [("place", "no pose yet")]
        x_m, y_m, z_m = estimate.vehicle.position_w_m.tolist()
        q_w_flu_wxyz = estimate.vehicle.q_w_flu_wxyz
        lean_deg = math.degrees(math.acos(min(1.0, float(up_axis(q_w_flu_wxyz)[2]))))
        residual = "not reported" if math.isnan(frame.residual_m) else f"{1e3 * frame.residual_m:.1f} mm"
        return [
            ("place", f"x {x_m:+.3f}  y {y_m:+.3f}  z {z_m:+.3f} m, {1e3 * age_s(estimate, self._now_s):.0f} ms old"),
            ("heading", f"{math.degrees(float(yaw_of(q_w_flu_wxyz))):+.1f} degrees, leaning {lean_deg:.1f}"),
            ("residual", residual),
        ]
