"""Servos on the bench: reading their state, switching their torque, clearing their faults."""

import asyncio
import json
import signal

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.cli.arms.bench import CLOCK, Bench, cycles, failed, open_bus
from companion.cli.arms.table import REFRESH_HZ, CycleMeter, found_table, state_json, state_table, torque_words
from companion.cli.operator.exit_codes import FAILED
from companion.core.interfaces import ArmError
from companion.core.types import ArmStatus

_METER_S = 0.6
"""Time over which the bus cycles are counted before a single table is printed."""


async def ping_servos(bench: Bench, console: Console) -> None:
    """Print the servos that answered; ArmError lists everything that is missing or wrong."""
    async with open_bus(bench.arms) as bus:
        console.print(found_table(bench.arms, bus.inspected.found, bus.status()))
        for warning in bus.warnings:
            console.print(Text(warning, style="yellow"), soft_wrap=True)
    warned = len(bus.warnings)
    set_up = f"with {warned} warning{'s' if warned > 1 else ''}, see above" if warned else "set as they must be"
    typer.echo(f"all 8 servos on {bench.arms.port} answer and can be used, {set_up}")


async def read_servos(bench: Bench, console: Console, once: bool, as_json: bool) -> int:
    """Print the servos' state, live or once; return the exit code."""
    async with open_bus(bench.arms, strict=False) as bus:
        remarks = (*bus.inspected.complaints, *bus.warnings)
        meter = CycleMeter()
        meter.take(bus.status(), CLOCK.now_s())
        if not once:
            await _read_live(bench, bus, console, meter, remarks)
            return 0
        await asyncio.sleep(_METER_S)
        await cycles(bus, 1)
        status, now_s = bus.status(), CLOCK.now_s()
        if as_json:
            typer.echo(json.dumps(state_json(bench.arms, status, now_s, meter.take(status, now_s), remarks), indent=2))
        else:
            console.print(_state(bench, status, meter, remarks))
        return FAILED if status.faults or bus.inspected.complaints else 0


async def _read_live(
    bench: Bench, bus: DynamixelBus, console: Console, meter: CycleMeter, remarks: tuple[str, ...]
) -> None:
    enough = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, enough.set)
    with Live(
        console=console,
        refresh_per_second=REFRESH_HZ,
        get_renderable=lambda: _state(bench, bus.status(), meter, remarks),
    ):
        await enough.wait()


def _state(bench: Bench, status: ArmStatus, meter: CycleMeter, remarks: tuple[str, ...]) -> Group:
    now_s = CLOCK.now_s()
    table = state_table(bench.arms, status, now_s, meter.take(status, now_s), None)
    faults = [fault.text for fault in status.faults]
    return Group(table, *(Text(text, style="red") for text in dict.fromkeys([*faults, *remarks])))


async def switch_torque(bench: Bench, on: bool) -> None:
    """Switch torque on without a jump if no servo has a fault, or off at all servos that answer."""
    async with open_bus(bench.arms, strict=on) as bus:
        try:
            await (bus.torque_on() if on else bus.torque_off())
        except ArmError as error:
            raise failed(error) from error
    if on:
        typer.echo("torque is on: all 8 joints hold where they are; `companion arms torque off` lets them go")
    else:
        typer.echo("torque is off: all 8 joints are limp")


async def clear_servos(bench: Bench) -> None:
    """Clear latched faults, then inspect all servos again; typer.Exit when something is still wrong."""
    async with open_bus(bench.arms, strict=False) as bus:
        for fault in bus.status().faults:
            typer.echo(f"latched: {fault.text}")
        typer.echo("nothing was latched" if not bus.status().faults else "clearing ...")
        try:
            await bus.clear_faults()
        except ArmError as error:
            raise failed(error) from error
        await cycles(bus, 2)
        torque = torque_words(bus.status())
    try:
        async with open_bus(bench.arms):
            pass
    except ArmError as error:
        raise failed(error) from error
    typer.echo(f"all 8 servos are without fault; {torque}")
