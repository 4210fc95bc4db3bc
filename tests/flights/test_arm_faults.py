"""Every fault of the servo bus, injected in flight: the driver's own code and dynamixel-sdk's meet the mock's servos.

A few fly in real time, over a pseudo-terminal, MAVSDK and qtm-rt: those that are about the port and its timing. The
table is docs/arms.md's; a test compares the two.
"""

import asyncio
import json
import logging
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from companion.arms.model import JOINT_COUNT, JOINT_NAMES
from companion.arms.state_machine import ArmPhase
from companion.cli.demo.mock_process import free_ports
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig, load_config
from companion.config.controller_config import load_controller
from companion.flight.flight_loop import FlightLoop
from companion.records.recorder import Recorder
from companion.service.local_operator import LocalOperator, open_local_operator
from companion.service.planning import plan_motion
from companion.supervisor.flight_state import Phase, TakeoffRequest
from mock_autopilot.servos.config import Fault
from tests.flights.command import ROOT
from tests.flights.simulated import BRISK, Flight, Step, fly
from tests.flights.test_simulated_arms import mock_arms, play, swing, torque
from tests.flights.test_simulated_flights import DOWN, QUICK_ARM, ask, until, wait
from tests.warm import mock_process
from tests.watchdog_timer import NoWatchdogTimer

pytestmark = pytest.mark.slow

HEIGHT_M = 0.5
SILENT_S, TOO_LATE_S = 0.5, 0.8
"""0.2 on a vehicle; here the mocks share a busy computer with us, and an answer that is to be late must be later."""
STILL_RAD = 0.02
LANDS, FLIES_ON = "lands", "flies on"


@dataclass(frozen=True)
class Row:
    """One fault and how it ends."""

    name: str
    """Name in the table of the docs."""
    fault: dict[str, Any]
    flight: str
    says: str
    """Regular expression for the reason and the driver's own log."""
    joints: tuple[str, ...]
    """Those that must be named in the driver's log."""
    sound: int
    """So many joints at least are read and hold still to the end."""
    real: bool = False
    """Flown in real time."""


def one(name: str, fault: dict[str, Any], joint: str, words: str, *, real: bool = False) -> Row:
    """A fault of one servo, which leaves the others sound."""
    return Row(name, fault, LANDS, f"^{re.escape(joint)} .*{words}", (joint,), JOINT_COUNT - 1, real)


ROWS = [
    one("a servo does not answer", {"kind": "missing", "id": 6}, "left.elbow_pitch", "not answered"),
    one("a servo is overloaded", {"kind": "overload", "id": 6}, "left.elbow_pitch", "overloaded"),
    one("a claw is overloaded", {"kind": "overload", "id": 4}, "right.claw", "overloaded"),
    one("a servo is too hot", {"kind": "hot", "id": 1}, "right.shoulder_pitch", "overheating"),
    Row("the supply is low", {"kind": "voltage"}, LANDS, r"input voltage", JOINT_NAMES, 0),
    one("a servo reboots", {"kind": "reboot", "id": 3}, "right.elbow_roll", "(rebooted|not answered)"),
    one(
        "every answer of a servo is late",
        {"kind": "late", "id": 5, "late_s": TOO_LATE_S},
        "left.shoulder_pitch",
        "not answered",
    ),
    one("every answer of a servo is broken", {"kind": "corrupt", "id": 7}, "left.elbow_roll", "not answered"),
    Row("the bus falls silent", {"kind": "silent_bus"}, LANDS, "not answered", JOINT_NAMES, 0),
    Row("the adapter is unplugged", {"kind": "port_gone"}, LANDS, r"^the arms. port .* is gone", (), 0, real=True),
    Row("answers are late for a moment", {"kind": "late", "id": 5, "for_s": 0.1}, FLIES_ON, "", (), JOINT_COUNT),
    Row(
        "an answer now and then is broken",
        {"kind": "corrupt", "id": 2, "every": 3},
        FLIES_ON,
        "",
        (),
        JOINT_COUNT,
        real=True,
    ),
]


def rows(ends: str, *, real: bool) -> list[Row]:
    """Return the rows of the table with this end that are flown for real, or not."""
    return [row for row in ROWS if (row.flight, row.real) == (ends, real)]


@dataclass
class Stack:
    """Operator, mocks and record of one flight."""

    operator: LocalOperator
    mocks: asyncio.subprocess.Process
    config: CompanionConfig
    recorder: Recorder


@asynccontextmanager
async def stack() -> AsyncIterator[Stack]:
    """The service here, the mocks in a process of their own, as in the demo."""
    ports = free_ports()
    config = load_config(ROOT / "config" / "demo.toml")
    assert config.arms is not None
    config = config.model_copy(
        update={
            "px4": config.px4.model_copy(update={"url": f"udpin://127.0.0.1:{ports.client}"}),
            "mocap": config.mocap.model_copy(update={"port": ports.qualisys}),
            "arms": config.arms.model_copy(update={"port": ports.servo_link, "silent_s": SILENT_S}),
            "flight": BRISK,
        }
    )
    law = load_controller("etnn", config.vehicle_model(), 0.01)
    recorder = Recorder()
    async with (
        mock_process(ROOT / "config" / "mock.toml", 1, ports) as mocks,
        open_local_operator(config, law, recorder, NoWatchdogTimer()) as operator,
    ):
        yield Stack(operator, mocks, config, recorder)


async def up_and_swinging(flying: Stack) -> None:
    """Hover with both arms in motion."""
    service = flying.operator.service
    await flying.operator.do("arm")
    await flying.operator.do("takeoff", height_m=HEIGHT_M)
    assert flying.config.arms is not None
    motion = plan_motion("swing", 60.0, flying.config.arms, service.arms.held_rad)
    service.arms.begin(motion.trajectory)
    await asyncio.sleep(0.5 * motion.approach_s)


def break_it(flying: Stack, fault: dict[str, Any]) -> None:
    """Inject this servo fault at the mock from now on."""
    assert flying.mocks.stdin is not None
    flying.mocks.stdin.write(f"servo-fault {json.dumps(fault)}\n".encode())


async def until_phase(flying: Stack, phase: Phase, within_s: float) -> None:
    async with asyncio.timeout(within_s):
        while flying.operator.service.phase is not phase:  # noqa: ASYNC110 - the phase has no event
            await asyncio.sleep(0.02)


def driver_log(caplog: pytest.LogCaptureFixture) -> str:
    """Return what the driver itself logged, one message a line."""
    told = (record for record in caplog.records if record.name.startswith("companion.adapters.dynamixel"))
    return "\n".join(record.message for record in told)


def assert_it_came_down(row: Row, loop: FlightLoop, recorder: Recorder, said: str) -> None:
    """For the right reason, arms in FAULT; joints that are read and have torque to the end hold still meanwhile."""
    assert re.search(row.says, loop.flight.reason), loop.flight.reason
    assert loop.flight.touched_down
    assert loop.arms is not None
    assert loop.arms.state.phase is ArmPhase.FAULT
    for name in row.joints:
        assert name in said, f"the log names {name}"
    columns = recorder.arrays()
    landing = np.flatnonzero(columns["phase"] == "land")
    joints = columns["joint_position_rad"][landing[50] :]
    status = loop.arms.status
    fresh = status.read_s > status.read_s.max() - 0.5
    sound = status.torque_on & fresh & np.isfinite(joints).all(axis=0)
    assert sound.sum() >= row.sound
    if sound.any():
        assert np.ptp(joints[:, sound], axis=0).max() < STILL_RAD, "all the way down"


def assert_nothing_came_of_it(loop: FlightLoop) -> None:
    """But that it was noticed."""
    assert loop.flight.phase is Phase.HOLD
    assert loop.arms is not None
    assert loop.arms.state.phase is ArmPhase.MOVING
    assert loop.arms.status.bad_packets > 0, "it was noticed"


@pytest.mark.realtime
@pytest.mark.parametrize("row", rows(LANDS, real=True), ids=lambda row: row.name)
async def test_a_fault_that_ends_the_flight(row: Row, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    async with stack() as flying:
        await up_and_swinging(flying)
        break_it(flying, row.fault)
        await until_phase(flying, Phase.LAND, 3.0)
        await until_phase(flying, Phase.DISARMED, 20.0)
        assert_it_came_down(row, flying.operator.service.loop, flying.recorder, driver_log(caplog))


@pytest.mark.realtime
@pytest.mark.parametrize("row", rows(FLIES_ON, real=True), ids=lambda row: row.name)
async def test_a_fault_that_the_bus_gets_over(row: Row) -> None:
    async with stack() as flying:
        await up_and_swinging(flying)
        break_it(flying, row.fault)
        await asyncio.sleep(2.0)
        assert_nothing_came_of_it(flying.operator.service.loop)
        await flying.operator.do("land")
        assert flying.operator.service.loop.flight.reason == ""
    assert "stow" in set(flying.recorder.arrays()["phase"])


def broken(fault: dict[str, Any]) -> Step:
    """Return a step that injects this servo fault from then on, in simulated time."""

    def step(flight: Flight) -> bool:
        servos = flight.room.bench.world.servos
        assert servos is not None
        servos.inject(Fault.model_validate(fault))
        return True

    return step


async def flown(fault: dict[str, Any], end: list[Step]) -> tuple[Flight, Recorder]:
    """In simulated time: up and swinging, the fault, and its end."""
    config = CompanionConfig(flight=BRISK, arms=ArmsConfig(silent_s=SILENT_S))
    up = [
        torque,
        *QUICK_ARM,
        ask(TakeoffRequest(HEIGHT_M)),
        until(Phase.HOLD),
        play(swing()),
        wait(0.5 * swing().approach_s),
    ]
    flight = await fly([*up, broken(fault), *end], config=config, arms=mock_arms(), real_driver=True)
    recorder = Recorder()
    for tick in flight.ticks:
        recorder(tick)
    return flight, recorder


@pytest.mark.parametrize("row", rows(LANDS, real=False), ids=lambda row: row.name)
async def test_a_fault_that_ends_the_flight_in_simulated_time(row: Row, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    flight, recorder = await flown(row.fault, [until(Phase.LAND), until(Phase.DISARMED)])
    assert_it_came_down(row, flight.loop, recorder, driver_log(caplog))


@pytest.mark.parametrize("row", rows(FLIES_ON, real=False), ids=lambda row: row.name)
async def test_a_fault_that_the_bus_gets_over_in_simulated_time(row: Row) -> None:
    def look(flight: Flight) -> bool:
        assert_nothing_came_of_it(flight.loop)
        return True

    flight, _ = await flown(row.fault, [wait(2.0), look, *DOWN])
    assert flight.loop.flight.reason == ""
    assert Phase.STOW in flight.phases()


def test_the_table_in_the_docs_has_these_rows_and_no_other() -> None:
    text = (ROOT / "docs" / "arms.md").read_text(encoding="utf-8")
    section = text[text.index("| fault | how it is detected") :].split("\n\n")[0]
    printed = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines()[2:]]
    assert [(line[0], line[-1]) for line in printed] == [(row.name, row.flight) for row in ROWS]
