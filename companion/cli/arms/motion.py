"""Execution of a planned motion on the bench: torque on without a jump, the motion, then hold in any case."""

import asyncio
import math
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext
from dataclasses import dataclass

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.arms.model import JOINT_NAMES
from companion.arms.state_machine import ArmPhase
from companion.arms.trajectory import JointTrajectory
from companion.cli.arms.bench import CLOCK, Bench, cycles, open_bus
from companion.cli.arms.plan import Wish
from companion.cli.arms.table import REFRESH_HZ, CycleMeter, state_table
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.core.interfaces import ArmError
from companion.core.types import ArmFaultKind, Array
from companion.flight.arm_step import ArmStep, ArmTick
from companion.supervisor.flight_state import FlightState

MOVED_RAD = 0.05
"""Largest distance of a joint from the start of the plan; beyond it the user agreed to another motion."""
LONGEST_GAP_S = 0.3
"""Longest pause of this process; the motion runs by the clock, so after a longer one the arms would jump."""
_READY_S = 2.0
_STILL_RADPS = 0.05
_SETTLE_S = 1.5
_ON_THE_GROUND = FlightState()
_RELEASE = "`companion arms torque off` lets them go"


@dataclass(frozen=True)
class Ended:
    """Result of a motion: exit code and sentence."""

    code: int
    text: str


async def move_arms(bench: Bench, wish: Wish, agreed_rad: Array, console: Console) -> Ended:
    """Run the motion from the present pose, which must still be the one the user agreed to, (8,).

    Raises ArmError when nothing was moved: a servo is missing, wrong or refuses torque, or the arms have moved.
    """
    async with open_bus(bench.arms) as bus, _interrupts() as interrupts:
        mover = _Mover(bus, bench, interrupts)
        try:
            held_rad = await mover.hold_here()
            _check_still_there(bus.status().position_rad, agreed_rad)
            motion = wish.plan_from(held_rad).trajectory
            console.print("torque is on, the arms move; Ctrl-C stops them", highlight=False)
            with mover.display(console, wish.name):
                return await mover.run(motion)
        except BaseException:
            bus.hold()  # after any error nothing must keep moving
            await cycles(bus, 3)
            raise


class _Mover:
    """Loop that runs the flight software's arm step, which stops the arms on a fault."""

    def __init__(self, bus: DynamixelBus, bench: Bench, interrupts: list[signal.Signals]) -> None:
        self._bus, self._arms, self._interrupts = bus, bench.arms, interrupts
        self._period_s = 1.0 / bench.arms.rate_hz
        settings = bench.config
        self._stage = ArmStep(bus, bench.arms, settings.vehicle_model(), settings.airframe(), self._period_s)
        self._meter = CycleMeter()
        self._tick_s = math.nan
        self._began_s = self._duration_s = math.nan
        self._shown: ArmTick | None = None

    async def hold_here(self) -> Array:
        """Switch torque on in the present pose; return the goals that hold it, rad (8,). ArmError on a time-out."""
        await self._bus.torque_on()
        end_s = CLOCK.now_s() + _READY_S
        status = self._bus.status()
        while np.isnan(status.held_rad).any() or status.faults:
            if CLOCK.now_s() > end_s:
                said = [fault.text for fault in status.faults]
                raise ArmError("; ".join(said) or "the arms did not get ready: not every joint has torque")
            await asyncio.sleep(self._period_s)
            status = self._bus.status()
        return status.held_rad

    async def run(self, motion: JointTrajectory) -> Ended:
        """Run the motion from the present goals until its end, an interrupt or a fault."""
        self._look_and_tick()
        self._stage.play(motion, _ON_THE_GROUND.phase)
        self._tick_s = self._began_s = CLOCK.now_s()
        self._duration_s = motion.duration_s
        presses = 0
        while self._stage.state.motion is not None:
            if len(self._interrupts) > presses:
                presses = len(self._interrupts)
                if presses > 1:
                    return await self._stopped("stopped at once", INTERRUPTED)
                self._stage.stop("interrupted")
            gap_s = await self._tick()
            if gap_s > LONGEST_GAP_S:
                return await self._stopped(f"this program stood still for {gap_s:.1f} s in the middle of it", FAILED)
        return await self._end(stopped=presses > 0)

    async def _tick(self) -> float:
        """Run one cycle; return the time since the last one, s."""
        now_s = CLOCK.now_s()
        gap_s, self._tick_s = now_s - self._tick_s, now_s
        self._stage.read(now_s, _ON_THE_GROUND)
        if not gap_s > LONGEST_GAP_S:
            self._shown = self._stage.tick(now_s, _ON_THE_GROUND)
        await asyncio.sleep(max(0.0, now_s + self._period_s - CLOCK.now_s()))
        return gap_s

    async def _stopped(self, why: str, code: int) -> Ended:
        self._bus.hold()
        await self._until_still(self._look)
        return Ended(code, f"{why}: the arms hold where they are, torque is on; {_RELEASE}")

    async def _end(self, stopped: bool) -> Ended:
        holding = self._stage.state.phase is ArmPhase.HOLDING
        await self._until_still(self._look_and_tick if holding else self._look)
        if self._stage.fault:
            cure = "`companion arms read` shows them, `companion arms clear` comes before the next motion"
            return Ended(FAILED, f"{self._stage.fault}\n  the arms were stopped and hold where they can; {cure}")
        if self._stage.state.phase is not ArmPhase.HOLDING:
            return Ended(FAILED, "the arms lost their torque during the motion")
        if stopped:
            text = f"interrupted: the arms came to rest on their way and hold, torque is on; {_RELEASE}"
            return Ended(INTERRUPTED, text)
        return Ended(0, f"done: the arms hold, torque is on{self._off_goal()}; {_RELEASE}")

    def _look(self) -> None:
        self._stage.read(CLOCK.now_s(), _ON_THE_GROUND)

    def _look_and_tick(self) -> None:
        self._look()
        self._shown = self._stage.tick(CLOCK.now_s(), _ON_THE_GROUND)

    async def _until_still(self, look: Callable[[], object]) -> None:
        """Wait until the last goals are sent and all joints that answer are at rest, if the bus still works."""
        if any(fault.kind is ArmFaultKind.BUS for fault in self._bus.status().faults):
            return
        await cycles(self._bus, 3, _SETTLE_S)
        end_s = CLOCK.now_s() + _SETTLE_S
        while CLOCK.now_s() < end_s:
            look()
            if np.nanmax(np.abs(self._stage.status.velocity_radps)) < _STILL_RADPS:
                return
            await asyncio.sleep(self._period_s)

    def _off_goal(self) -> str:
        if self._stage.state.hold_rad is None:
            return ""
        off = np.degrees(self._stage.status.position_rad - self._stage.state.hold_rad)
        worst = int(np.argmax(np.abs(off)))
        return f" ({JOINT_NAMES[worst]} farthest from its goal, by {off[worst]:+.1f} degrees)"

    def display(self, console: Console, name: str) -> Live | nullcontext[None]:
        """Return a live table with its own thread; a null context without a terminal."""
        if not console.is_terminal:
            return nullcontext()
        return Live(
            console=console,
            refresh_per_second=REFRESH_HZ,
            transient=True,
            get_renderable=lambda: self._picture(name),
        )

    def _picture(self, name: str) -> Group:
        now_s, status = CLOCK.now_s(), self._bus.status()
        goal = self._shown.goal if self._shown is not None else None
        table = state_table(
            self._arms, status, now_s, self._meter.take(status, now_s), None if goal is None else goal.position_rad
        )
        return Group(Text(f"{name}: {self._progress(now_s)}  [{self._stage.state.phase}]"), table)

    def _progress(self, now_s: float) -> str:
        if math.isnan(self._began_s):
            return "about to move"
        return f"{min(now_s - self._began_s, self._duration_s):.1f} of {self._duration_s:.1f} s"


def _check_still_there(present_rad: Array, agreed_rad: Array) -> None:
    moved = np.abs(present_rad - agreed_rad)
    worst = int(np.argmax(moved))
    if moved[worst] > MOVED_RAD:
        raise ArmError(
            f"nothing was moved: {JOINT_NAMES[worst]} is {math.degrees(moved[worst]):.0f} degrees from where it was "
            f"when the motion was shown; run the command again. The arms hold, torque is on; {_RELEASE}"
        )


@asynccontextmanager
async def _interrupts() -> AsyncIterator[list[signal.Signals]]:
    """Collect the signals of Ctrl-C, termination and a closed terminal in a list."""
    came: list[signal.Signals] = []
    loop, minded = asyncio.get_running_loop(), (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in minded:
        loop.add_signal_handler(number, came.append, number)
    try:
        yield came
    finally:
        for number in minded:
            loop.remove_signal_handler(number)
