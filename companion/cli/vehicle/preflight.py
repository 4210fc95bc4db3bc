"""`companion preflight`: the checks before a vehicle may arm, made from this computer."""

import asyncio
import json
import re
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NoReturn

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from companion.adapters.mqtt.link import BusLink
from companion.adapters.system.clock import MonotonicClock
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import vehicle_settings
from companion.cli.output import check_output
from companion.cli.terminal import show_cursor
from companion.cli.vehicle.hand_test import carry
from companion.config.companion_config import CompanionConfig
from companion.config.operator_config import OperatorConfig
from companion.config.trajectory_files import Curve, trajectory_named
from companion.core.interfaces import FlightError
from companion.preflight.checks.all_checks import check_operator
from companion.preflight.checks.check import Check
from companion.preflight.checks.hand_test import HandTest
from companion.preflight.hand_test_file import hand_test_path, require_writable, write_hand_test
from companion.preflight.link_observer import open_link_observer
from companion.preflight.live_observer import DevicesMissingError, open_live_observer, require_frames
from companion.preflight.service_facts import preflight as check_everything
from companion.preflight.service_facts import settle
from companion.protocol.commands import Command
from companion.trajectories.reference import Trajectory
from companion.trajectories.room_check import check_trajectory

_PARAMETER = re.compile(r"[A-Z0-9]+(?:_[A-Z0-9]+)+")
"""Pattern of checks that are named after a PX4 parameter."""
CARRIED = "carried by hand: passed. Nothing else was looked at: `companion preflight` says whether it may arm"
_LISTEN_S = 3.0
"""Time limit of the broker's link, which first listens for another service of this vehicle's name."""
_FEW = 3
_GLANCE = 12
"""Length above which a list repeats the failed checks at its end."""


def preflight(config: Path | None, trajectory: str | None, by_hand: bool, as_json: bool, out: Path | None) -> NoReturn:
    """Make the checks of `companion preflight`, or the hand test, directly with the devices; exit with its code.

    Nothing is commanded; only poses are sent to the autopilot's estimator, and the operator's broker sees a client.
    """
    settings = vehicle_settings(config)
    out = out or Path(settings.records.folder)
    flown = trajectory_of(trajectory, settings)
    if by_hand:
        require_frames(settings)
        require_writable(settings.preflight)
    check_output(out, None)
    console = Console(stderr=as_json)
    try:
        if by_hand:
            checks = asyncio.run(carry_and_keep(settings, out, console))
        else:
            checks = asyncio.run(_look(settings, flown, out, console))
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/]")
        raise typer.Exit(INTERRUPTED) from None
    if by_hand:
        show(checks, console, as_json, CARRIED, "fail: carried by hand does not pass")
    else:
        show(checks, console, as_json)
    raise typer.Exit(FAILED if any(check.refuses for check in checks) else 0)


def trajectory_of(name: str | None, config: CompanionConfig) -> Trajectory | None:
    """Return the trajectory that `--trajectory` names; ConfigError when it leaves the room or does not exist."""
    if name is None:
        return None
    trajectory = trajectory_named(name, Curve(height_m=config.flight.takeoff_height_m))
    check_trajectory(trajectory, config.room, name)
    return trajectory


async def _look(
    config: CompanionConfig, trajectory: Trajectory | None, out: Path, console: Console
) -> tuple[Check, ...]:
    with console.status("connecting") as status:
        show_cursor(console)
        async with _broker(config.operator) as (operator_age_s, met_broker), open_link_observer(config) as link:
            try:
                async with open_live_observer(
                    config,
                    out,
                    forward_vision=True,
                    tell=lambda text: status.update(Text(text)),
                    ground=None if link is None else link.poses,
                ) as (running, _):
                    status.update("looking at motion capture and the autopilot, asking for its parameters")
                    met = replace(
                        running, operator_age_s=operator_age_s, law_link=None if link is None else link.status
                    )
                    return await check_everything(met, config, trajectory)
            except DevicesMissingError as missing:
                await met_broker()
                return *check_operator(operator_age_s(), config.operator), *missing.checks


@asynccontextmanager
async def _broker(
    operator: OperatorConfig | None,
) -> AsyncIterator[tuple[Callable[[], float], Callable[[], Awaitable[None]]]]:
    """Yield a function for the age of the operator's broker, s, and one that waits until it answers or times out.

    The service's embedded broker does not run yet, which is no fault.
    """
    if operator is None or operator.embedded:
        yield (lambda: 0.0), partial(asyncio.sleep, 0)
        return
    link = BusLink(operator, MonotonicClock(), secrets.token_hex(8))
    async with link.listening(_refuse):
        listening = asyncio.create_task(link.listened(_LISTEN_S), name="companion.listen")
        try:
            yield link.age_s, lambda: asyncio.shield(listening)
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)


def _refuse(command: Command, _: object) -> None:
    raise FlightError(f"a preflight only looks: {command.verb} is for `companion serve`")


async def carry_and_keep(config: CompanionConfig, out: Path, console: Console) -> tuple[Check, ...]:
    """Run the hand test, and store that it passed if all checks pass.

    Call `require_writable` first. FlightError while the vehicle is armed.
    """
    async with open_live_observer(config, out, forward_vision=True) as (running, _):
        await settle(running, config.preflight)
        if running.autopilot.status().armed:
            raise FlightError("the vehicle is armed: it is carried by hand only disarmed, better without propellers")
        checks = await carry(running, console)
    if all(check.passed for check in checks):
        path = write_hand_test(config.preflight, HandTest(config.mocap.body, datetime.now(tz=UTC)))
        console.print(f"kept in {path}", markup=False, highlight=False, soft_wrap=True)
    else:
        console.print(f"not kept in {hand_test_path(config.preflight)}", markup=False, highlight=False, soft_wrap=True)
    return checks


def show(
    checks: Sequence[Check],
    console: Console,
    as_json: bool,
    good: str = "it may arm",
    bad: str = "fail: arming is refused",
    with_verdict: bool = True,
) -> None:
    """Print the checks, the failed ones again at the end, and the verdict; or JSON on standard output."""
    if as_json:
        shown = (replace(check, todo="") if check.passed else check for check in checks)
        typer.echo(json.dumps([asdict(check) for check in shown], indent=2))
        return
    console.print(_table(_gathered(checks), with_todo=len(checks) <= _GLANCE))
    wrong = [check for check in checks if not check.passed]
    if wrong and len(checks) > _GLANCE:
        console.print(Text("\nwhat to do", style="bold"))
        console.print(_table(wrong))
    if not with_verdict:
        return
    refused = sum(check.refuses for check in checks)
    warned = sum(not check.passed for check in checks) - refused
    warnings = f", {warned} warning{'s' if warned > 1 else ''}" if warned else ""
    verdict = (f"{refused} of {len(checks)} {bad}", "red") if refused else (good, "green")
    console.print(Text.assemble(verdict, warnings))


def _gathered(checks: Sequence[Check]) -> list[Check]:
    """Return the checks with passed PX4 parameters merged into one, before the failed ones."""
    of_px4 = [check for check in checks if _PARAMETER.fullmatch(check.name)]
    right = [check for check in of_px4 if check.passed]
    if len(right) < _FEW:
        return list(checks)
    place = checks.index(of_px4[0])
    line = Check("PX4's parameters", True, f"{len(right)} of {len(of_px4)} are right")
    rest = [check for check in checks if check not in right]
    return [*rest[:place], line, *rest[place:]]


def _table(checks: Sequence[Check], with_todo: bool = True) -> Table:
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column()
    for check in checks:
        word, style = ("pass", "green") if check.passed else ("FAIL", "red") if check.must else ("warn", "yellow")
        says = Text(check.says)
        if not check.passed and with_todo:
            says.append(f"\n-> {check.todo}", style=style)
        table.add_row(Text(word, style=style), Text(check.name), says)
    return table
