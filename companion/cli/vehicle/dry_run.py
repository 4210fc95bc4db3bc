"""`companion dry-run`: everything live in the real room, disarmed, with nothing sent."""

import asyncio
import math
import signal
from contextlib import AsyncExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
import uvloop
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from companion.cli.complete import trajectories
from companion.cli.demo.fault_messages import shorter
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import AllowUnstable, ControllerName, VehicleConfigFile, vehicle_settings
from companion.cli.output import check_output, kept
from companion.cli.terminal import show_cursor
from companion.cli.vehicle.preflight import show, trajectory_of
from companion.config.companion_config import CompanionConfig
from companion.control.controller import Controller
from companion.core.interfaces import AutopilotError, FlightError
from companion.flight.assembly import controller_of, margin_in
from companion.flight.tick import Tick
from companion.geometry.frames import up_axis, yaw_of
from companion.preflight.checks import agreement, vehicle
from companion.preflight.checks.agreement import apart
from companion.preflight.checks.all_checks import Facts, check_mocap, check_place
from companion.preflight.checks.check import Check
from companion.preflight.checks.dry_run_report import DryRunFacts, check_health, check_law
from companion.preflight.dry_run import DryRun
from companion.preflight.live_observer import open_live_observer, require_frames
from companion.preflight.service_facts import Running, facts_of, watch
from companion.records.recorder import Recorder
from companion.trajectories.reference import Trajectory

_REFRESH_HZ = 4.0
_POLL_S = 0.02


def dry_run(
    config: VehicleConfigFile = None,
    seconds: Annotated[float, typer.Option(min=1.0, max=3600.0, metavar="S", help="Duration, s.")] = 20.0,
    trajectory: Annotated[
        str | None,
        typer.Option(
            help="Compute setpoints for ellipse, figure8, or a CSV file.  [default: hold in place]",
            autocompletion=trajectories,
        ),
    ] = None,
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Write the record into this folder.  [default: as configured]")
    ] = None,
) -> None:
    """Read the real room and show the setpoints, disarmed; no setpoint, pose, mode, torque or goal is sent.

    Exit codes: 0 nothing would have ended a flight, 1 something would have, 2 could not be started or the vehicle is
    armed, 130 after Ctrl-C, which ends it early and keeps the record.
    """
    settings = vehicle_settings(config)
    require_frames(settings)
    out = out or Path(settings.records.folder)
    flown = trajectory_of(trajectory, settings)
    loaded = controller_of(settings, controller or settings.control.controller, allow_unstable)
    margin_in(settings, loaded)
    check_output(out, None)
    console = Console(stderr=as_json)
    dry = _DryRun(settings, loaded.law, flown, out, console)
    try:
        checks = uvloop.run(dry.run(seconds))
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/] before it began")
        raise typer.Exit(INTERRUPTED) from None
    show(checks, console, as_json, "nothing would have ended a flight", "would have ended a flight")
    record = out / f"{datetime.now(tz=UTC).astimezone():%Y%m%d-%H%M%S}-dry-run.npz"
    lost = kept(record, dry.recorder.write)
    if lost:
        typer.echo(f"companion: {lost}", err=True)
    else:
        console.print(f"record {record}", markup=False, highlight=False, soft_wrap=True)
    failed = FAILED if lost or any(check.refuses for check in checks) else 0
    raise typer.Exit(INTERRUPTED if dry.interrupted else failed)


class _DryRun:
    """One run: devices, law, display and record."""

    def __init__(
        self,
        config: CompanionConfig,
        law: Controller,
        trajectory: Trajectory | None,
        out: Path,
        console: Console,
    ) -> None:
        self._config, self._law, self._trajectory = config, law, trajectory
        self._out, self._console = out, console
        self._tick: Tick | None = None
        self._end_s = math.inf
        self.recorder = Recorder()
        self.interrupted = False

    async def run(self, seconds: float) -> tuple[Check, ...]:
        """Observe for `seconds`; return the checks."""
        async with AsyncExitStack() as devices:
            with self._console.status("connecting") as waiting:
                show_cursor(self._console)
                opened = open_live_observer(
                    self._config, self._out, forward_vision=False, tell=lambda text: waiting.update(Text(text))
                )
                running, observer = await devices.enter_async_context(opened)
                waiting.update("waiting until the autopilot says that it is disarmed")
                await _disarmed(running, self._config.px4.answer_timeout_s)
            dry = DryRun(running, self._config, self._law, self._trajectory, self._take)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                asyncio.get_running_loop().add_signal_handler(number, self._interrupt)
            self._console.print(f"observing for {seconds:g} s, sending nothing", highlight=False)
            observer.each = dry
            self._end_s = running.clock.now_s() + seconds
            mocap = self._config.mocap
            live = Live(
                console=self._console, refresh_per_second=_REFRESH_HZ, transient=True, get_renderable=self._table
            )
            with live:
                show_cursor(self._console)
                watched = await watch(running, mocap.body, mocap.delay_s, seconds, lambda: self.interrupted)
            observer.each = None
            return self._judge(facts_of(running, watched, {}, self._config.preflight), dry.seen)

    def _interrupt(self) -> None:
        self.interrupted = True

    def _take(self, tick: Tick) -> None:
        self._tick = tick
        self.recorder(tick)

    def _judge(self, facts: Facts, seen: DryRunFacts) -> tuple[Check, ...]:
        """Return the preflight checks that need nothing sent; the EKF gets no poses here."""
        config, limits = self._config, self._config.preflight
        tilts = agreement.check_tilts(facts.apart, limits.tilt_apart_rad)
        arms = vehicle.check_arms(facts.arms, config.arms.silent_s if config.arms else math.inf)
        return (
            *check_mocap(facts.mocap, config.safety, limits),
            vehicle.check_link(facts.status, facts.time_s, config.safety.autopilot_silent_s),
            vehicle.check_ground(facts.status),
            *tilts,
            vehicle.check_battery(facts.status, config.safety.battery_low),
            *arms,
            *check_place(facts.position_w_m, config.fence, config.flight.takeoff_height_m, self._trajectory),
            check_law(seen),
            check_health(seen),
        )

    def _table(self) -> Table:
        """Return the table of present measurements and of the setpoint that would be sent."""
        table = Table(box=None, pad_edge=False, show_header=False)
        tick = self._tick
        if tick is None or tick.vehicle is None:
            table.add_row("motion capture", "no pose yet")
            return table
        where = " ".join(f"{value:+.3f}" for value in tick.vehicle.position_w_m.tolist())
        heading_deg = math.degrees(float(yaw_of(tick.vehicle.q_w_flu_wxyz)))
        off = apart(tick.vehicle.q_w_flu_wxyz[None], tick.status.q_w_flu_wxyz[None])
        angles = (("roll", off.roll_rad), ("pitch", off.pitch_rad), ("heading", off.heading_rad))
        table.add_row("left", f"{max(0.0, self._end_s - tick.time_s):.0f} s")
        table.add_row(
            "motion capture", f"{1e3 * tick.age_s:.0f} ms old, at {where} m, heading {heading_deg:+.1f} degrees"
        )
        apart_words = ", ".join(f"{name} {math.degrees(angle):+.1f}" for name, angle in angles)
        table.add_row("autopilot less mocap", f"{apart_words} degrees (its heading is its own: it is sent no poses)")
        table.add_row("would send", _setpoint(tick))
        if tick.events:
            faults = "; ".join(f"{event.fault}: {shorter(event.text)}" for event in tick.events)
            table.add_row(Text("faults", style="red"), Text(faults))
        return table


def _setpoint(tick: Tick) -> str:
    if tick.limited is None:
        return "nothing"
    up = up_axis(tick.limited.setpoint.q_w_flu_wxyz)
    lean_deg, thrust = math.degrees(math.acos(min(1.0, float(up[2])))), float(tick.limited.setpoint.thrust)
    return f"lean {lean_deg:.1f} degrees ({up[0]:+.3f} {up[1]:+.3f} in W), thrust {thrust:.3f}"


async def _disarmed(running: Running, timeout_s: float) -> None:
    """Wait for the autopilot's state; FlightError when the vehicle is armed or in the air, AutopilotError if silent."""
    clock = running.clock
    begun_s = clock.now_s()
    while not math.isfinite((status := running.autopilot.status()).heartbeat_s) or status.in_air is None:
        if clock.now_s() - begun_s > timeout_s:
            silent = math.isinf(status.heartbeat_s)
            what = "sends no HEARTBEAT" if silent else "does not say whether the vehicle stands or flies"
            raise AutopilotError(f"the autopilot was heard once but {what}: look at the link")
        await asyncio.sleep(_POLL_S)
    if status.armed or status.in_air:
        raise FlightError("the vehicle is armed or in the air: a dry run is for one that stands, disarmed")
