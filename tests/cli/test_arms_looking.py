"""`companion arms ping, read, torque, clear` as a process against simulated servos on a pseudo-terminal."""

import json
from pathlib import Path

import pytest

from companion.adapters.dynamixel.bus import open_dynamixel
from companion.adapters.system.clock import MonotonicClock
from companion.arms.model import JOINT_NAMES
from companion.config.arms_config import ArmsConfig
from mock_autopilot.servos.config import FaultKind
from tests.cli.arms_rig import ARMS, arms_rig, until

pytestmark = pytest.mark.realtime


async def test_ping_lists_every_servo_and_changes_nothing(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        ran = await rig.run("ping")
        assert not any(rig.powered)
    assert ran.code == 0, ran.said
    rows = [line.split() for line in ran.out.splitlines() if line.startswith(("right.", "left."))]
    assert [row[0] for row in rows] == list(JOINT_NAMES)
    assert rows[1][1:8] == ["2", "XM430-W350", "45", "2.0", "1000000", "0", "12.0"]
    assert rows[1][9:] == ["+130.1"]
    assert rows[7][1:5] == ["8", "AX-12A", "24", "1.0"]
    assert "all 8 servos" in ran.out
    assert ran.out.endswith("answer and can be used, set as they must be\n")


async def test_ping_warns_of_a_setting_that_somebody_left_in_a_servo(tmp_path: Path) -> None:
    async with arms_rig(tmp_path, id1={"registers": {"homing_offset": 100}}) as rig:
        ran = await rig.run("ping")
    assert ran.code == 0, ran.said
    assert "right.shoulder_pitch (ID 1) has Homing Offset 100 (+0.15 rad)" in ran.out
    assert ran.out.endswith("answer and can be used, with 1 warning, see above\n")


async def test_a_motion_is_refused_with_all_that_is_missing_or_wrong(tmp_path: Path) -> None:
    async with arms_rig(tmp_path, id2={"firmware": 30}, id8={"return_delay_us": 500}) as rig:
        rig.fault(FaultKind.MISSING, 5)
        ran = await rig.run("home", "--yes")
        assert not any(rig.powered)
    assert ran.code == 2, ran.said
    assert "left.shoulder_pitch (ID 5) does not answer" in ran.err
    assert "right.elbow_pitch (ID 2) has firmware 30" in ran.err
    assert "left.claw (ID 8) waits 500 us" in ran.err
    assert "Traceback" not in ran.said


async def test_read_shows_the_healthy_servos_beside_a_missing_one(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        rig.fault(FaultKind.MISSING, 5)
        ran = await rig.run("read")  # no terminal: one table
    assert ran.code == 1, ran.said
    table, _, below = ran.out.partition("bus:")
    rows = {line.split()[0]: line.split() for line in table.splitlines() if line.startswith(("right.", "left."))}
    assert rows["right.elbow_pitch"][2] == "+130.1"
    assert rows["left.shoulder_pitch"][2:4] == ["?", "?"]
    assert rows["left.shoulder_pitch"][-1] == "silent"
    assert "left.shoulder_pitch (ID 5) does not answer" in below
    assert "cycles/s" in below


async def test_read_as_json_is_one_document_in_si_units(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        ran = await rig.run("read", "--json")
    assert ran.code == 0, ran.said
    state = json.loads(ran.out)
    assert [joint["joint"] for joint in state["joints"]] == list(JOINT_NAMES)
    angles = [joint["position_rad"] for joint in state["joints"]]
    assert angles == pytest.approx(ARMS.stow_rad().tolist(), abs=0.006)  # a count of an AX
    assert {joint["torque_on"] for joint in state["joints"]} == {False}
    assert {joint["voltage_v"] for joint in state["joints"]} == {12.0}
    assert state["cycles"] > 10
    assert state["faults"] == []


async def test_torque_holds_the_arms_where_they_are_until_it_is_switched_off(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        on = await rig.run("torque", "on")
        assert on.code == 0, on.said
        assert all(rig.powered)
        assert rig.joints_rad == pytest.approx(ARMS.stow_rad(), abs=0.01)
        rig.fault(FaultKind.MISSING, 5)  # it reaches the others all the same
        off = await rig.run("torque", "off")
        assert off.code == 1, off.said
        assert "torque is not off everywhere:\n  left.shoulder_pitch (ID 5)" in off.err
        assert len(off.err.strip().splitlines()) == 2
        assert rig.powered == [name == "left.shoulder_pitch" for name in JOINT_NAMES]


async def test_clear_forgets_what_an_earlier_program_left_latched_once_its_cause_is_gone(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        async with open_dynamixel(ArmsConfig(port=rig.alone.path), MonotonicClock()) as bus:
            await bus.torque_on()
        rig.fault(FaultKind.HOT, 2)
        rig.fault(FaultKind.OVERLOAD, 8)
        await until(lambda: not rig.powered[1] and not rig.powered[7])
        refused = await rig.run("ping")
        assert refused.code == 2, refused.said
        assert "right.elbow_pitch (ID 2) reports overheating, latched from before" in refused.err
        assert "`companion arms clear`" in refused.err
        rig.alone.bus.clear(FaultKind.OVERLOAD)
        still = await rig.run("clear")
        assert still.code == 1, still.said
        assert "latched: left.claw (ID 8) is overloaded" in still.out
        assert "right.elbow_pitch (ID 2) still reports overheating" in still.err
        assert "left.claw" not in still.err
        rig.alone.bus.clear()
        cleared = await rig.run("clear")
        assert cleared.code == 0, cleared.said
        assert "all 8 servos are without fault; without torque: right.elbow_pitch, left.claw" in cleared.out


async def test_a_second_program_on_the_bus_is_told_so(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig, open_dynamixel(ArmsConfig(port=rig.alone.path), MonotonicClock()):
        ran = await rig.run("ping")
    assert ran.code == 2, ran.said
    assert "is already in use by another process: end that one first" in ran.err
    assert len(ran.err.strip().splitlines()) == 1
