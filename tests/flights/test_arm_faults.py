"""Every fault of the servo bus, injected in flight: over the real MAVSDK, qtm-rt and dynamixel-sdk.

The table is docs/arms.md's; a test compares the two.
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

from companion.adapters.recorder import Recorder
from companion.arm_files import motion_named
from companion.arms.machine import ArmPhase
from companion.arms.model import JOINT_COUNT, JOINT_NAMES
from companion.arms.planning import plan
from companion.cli.mock_process import free_ports, mock_process
from companion.config import CompanionConfig, load_config
from companion.config_controller import load_controller
from companion.service import Service, open_service
from companion.supervisor.flight import Phase
from tests.dead_man import NoDeadMan
from tests.flights.command import ROOT

pytestmark = pytest.mark.realtime

HEIGHT_M = 0.5
BRISK = {"climb_speed_mps": 1.0, "descent_speed_mps": 0.4, "spool_up_s": 0.5}
"""A dozen flights are to be short."""
STILL_RAD = 0.02
LANDS, FLIES_ON = "lands", "flies on"


@dataclass(frozen=True)
class Row:
    """One fault and how it ends."""

    name: str
    """As in the table of the docs."""
    fault: dict[str, Any]
    flight: str
    says: str
    """What the reason must contain, and the driver's own log; a regular expression."""
    joints: tuple[str, ...]
    """Those that must be named in the driver's log."""
    sound: int
    """So many joints at least are read and hold still to the end."""


def one(name: str, fault: dict[str, Any], joint: str, words: str) -> Row:
    """A fault of one servo, which leaves the others sound."""
    return Row(name, fault, LANDS, f"^{re.escape(joint)} .*{words}", (joint,), JOINT_COUNT - 1)


ROWS = [
    one("a servo does not answer", {"kind": "missing", "id": 6}, "left.elbow_pitch", "not answered"),
    one("a servo is overloaded", {"kind": "overload", "id": 6}, "left.elbow_pitch", "overloaded"),
    one("a claw is overloaded", {"kind": "overload", "id": 4}, "right.claw", "overloaded"),
    one("a servo is too hot", {"kind": "hot", "id": 1}, "right.shoulder_pitch", "overheating"),
    Row("the supply is low", {"kind": "voltage"}, LANDS, r"input voltage", JOINT_NAMES, 0),
    one("a servo reboots", {"kind": "reboot", "id": 3}, "right.elbow_roll", "(rebooted|not answered)"),
    one(
        "every answer of a servo is late",
        {"kind": "late", "id": 5, "late_s": 0.3},
        "left.shoulder_pitch",
        "not answered",
    ),
    one("every answer of a servo is broken", {"kind": "corrupt", "id": 7}, "left.elbow_roll", "not answered"),
    Row("the bus falls silent", {"kind": "silent_bus"}, LANDS, "not answered", JOINT_NAMES, 0),
    Row("the adapter is pulled", {"kind": "port_gone"}, LANDS, r"^the arms. port .* is gone", (), 0),
    Row("answers are late for a moment", {"kind": "late", "id": 5, "for_s": 0.1}, FLIES_ON, "", (), JOINT_COUNT),
    Row("an answer now and then is broken", {"kind": "corrupt", "id": 2, "every": 3}, FLIES_ON, "", (), JOINT_COUNT),
]


@dataclass
class Stack:
    """Service, mocks and record of one flight."""

    service: Service
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
            "arms": config.arms.model_copy(update={"port": ports.servo_link}),
            "flight": config.flight.model_copy(update=BRISK),
        }
    )
    law = load_controller("etnn", config.vehicle_model(), 0.01).law
    recorder = Recorder()
    async with (
        mock_process(ROOT / "config" / "mock.toml", 1, ports) as mocks,
        open_service(config, law, recorder, NoDeadMan()) as service,
    ):
        yield Stack(service, mocks, config, recorder)


async def up_and_swinging(flying: Stack) -> None:
    """Hover with both arms in motion."""
    assert flying.config.arms is not None
    model = flying.config.arms.model()
    await flying.service.ready()
    held_rad = await flying.service.arms.prepare()
    swing = plan(model, motion_named("swing", 60.0).trajectory(model, held_rad), held_rad)
    await flying.service.arm()
    await flying.service.take_off(HEIGHT_M)
    await flying.service.arms.move(swing.trajectory)
    await asyncio.sleep(0.5 * swing.approach_s)


def break_it(flying: Stack, fault: dict[str, Any]) -> None:
    """From now on."""
    assert flying.mocks.stdin is not None
    flying.mocks.stdin.write(f"servo-fault {json.dumps(fault)}\n".encode())


async def until_phase(flying: Stack, phase: Phase, within_s: float) -> None:
    async with asyncio.timeout(within_s):
        while flying.service.phase is not phase:  # noqa: ASYNC110 - the phase has no event
            await asyncio.sleep(0.02)


def assert_healthy_joints_hold_still(flying: Stack, row: Row) -> None:
    """Joints that are read and have torque to the end have not moved since half a second into the landing."""
    columns = flying.recorder.arrays()
    landing = np.flatnonzero(columns["phase"] == "land")
    joints = columns["joint_position_rad"][landing[50] :]
    assert flying.service.loop.arms is not None
    status = flying.service.loop.arms.status
    fresh = status.read_s > status.read_s.max() - 0.5
    sound = status.torque_on & fresh & np.isfinite(joints).all(axis=0)
    assert sound.sum() >= row.sound
    if sound.any():
        assert np.ptp(joints[:, sound], axis=0).max() < STILL_RAD, "all the way down"


@pytest.mark.parametrize("row", [row for row in ROWS if row.flight == LANDS], ids=lambda row: row.name)
async def test_a_fault_that_ends_the_flight(row: Row, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    async with stack() as flying:
        await up_and_swinging(flying)
        break_it(flying, row.fault)
        await until_phase(flying, Phase.LAND, 3.0)
        await until_phase(flying, Phase.DISARMED, 20.0)
        flight = flying.service.loop.flight
        assert re.search(row.says, flight.reason), flight.reason
        assert flight.touched_down
        assert flying.service.loop.arms is not None
        assert flying.service.loop.arms.state.phase is ArmPhase.FAULT
    driver = [record.message for record in caplog.records if record.name.startswith("companion.adapters.dynamixel")]
    for name in row.joints:
        assert any(name in line for line in driver), f"the log names {name}"
    assert_healthy_joints_hold_still(flying, row)


@pytest.mark.parametrize("row", [row for row in ROWS if row.flight == FLIES_ON], ids=lambda row: row.name)
async def test_a_fault_that_the_bus_gets_over(row: Row) -> None:
    async with stack() as flying:
        await up_and_swinging(flying)
        break_it(flying, row.fault)
        await asyncio.sleep(2.0)
        assert flying.service.phase is Phase.HOLD
        arms = flying.service.loop.arms
        assert arms is not None
        assert arms.state.phase is ArmPhase.MOVING
        assert arms.status.bad_packets > 0, "it was noticed"
        await flying.service.land()
        assert flying.service.loop.flight.reason == ""
    assert "stow" in set(flying.recorder.arrays()["phase"])


def test_the_table_in_the_docs_has_these_rows_and_no_other() -> None:
    text = (ROOT / "docs" / "arms.md").read_text(encoding="utf-8")
    section = text[text.index("| fault | how it is noticed") :].split("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines()[2:]]
    assert [(row[0], row[-1]) for row in rows] == [(row.name, row.flight) for row in ROWS]
