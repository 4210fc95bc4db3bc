"""Motions of `companion arms` as a process: real SDK, real pseudo-terminal, servos that move in simulated time."""

import asyncio
import signal
from pathlib import Path

import numpy as np
import pytest

from companion.adapters.dynamixel.bus import open_dynamixel
from companion.adapters.system.clock import MonotonicClock
from companion.arms.model import JOINT_NAMES
from companion.config.arms_config import ArmsConfig
from companion.core.types import Array
from mock_autopilot.servos.config import FaultKind
from tests.cli.arms_rig import ARMS, ArmsRig, arms_rig, on_terminal, until
from tests.flights.command import Ran, Running

pytestmark = pytest.mark.realtime

ELBOW = JOINT_NAMES.index("right.elbow_pitch")
NEAR_RAD = 0.02
"""A servo's dead band and the count of an AX."""


async def _on_its_way(rig: ArmsRig, *command: str) -> Running:
    """A motion that has begun."""
    running = await rig.start(*command, "--yes")
    await running.until_line("the arms move")
    await rig.moved(ELBOW)
    return running


async def _ended(rig: ArmsRig, running: Running) -> tuple[Ran, Array]:
    """Return how the command ended and the joint angles at which the arms then stand and stay, rad."""
    ran = await running.ended()
    await until(lambda: rig.stands_still)
    stand_rad = rig.joints_rad
    await asyncio.sleep(0.2)
    np.testing.assert_allclose(rig.joints_rad, stand_rad, atol=NEAR_RAD)
    assert "Traceback" not in ran.said
    return ran, stand_rad


async def test_home_grip_and_stow_get_there_say_so_and_leave_the_arms_holding(tmp_path: Path) -> None:
    opened_rad = ARMS.home_rad()
    opened_rad[[3, 7]] = ARMS.poses.claw_open_rad
    ways = [(["home"], ARMS.home_rad()), (["grip", "open"], opened_rad), (["stow"], ARMS.stow_rad())]
    async with arms_rig(tmp_path) as rig:
        for command, goal_rad in ways:
            ran = await rig.run(*command, "--yes")
            assert ran.code == 0, ran.said
            plan, _, rest = ran.out.partition("torque is on, the arms move")
            assert "least clearance" in plan  # before anything moves
            assert ("torque is off; it is switched on" in plan) == (command == ["home"])
            assert "done: the arms hold, torque is on" in rest
            assert "`companion arms torque off` lets them go" in rest
            np.testing.assert_allclose(rig.joints_rad, goal_rad, atol=NEAR_RAD)
            assert all(rig.powered)


async def test_loaded_arms_do_not_sink_when_a_command_takes_them_over(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        async with open_dynamixel(ArmsConfig(port=rig.alone.path), MonotonicClock()) as bus:
            await bus.torque_on()
        rig.alone.load_nm = (-0.6, -0.4, 0.0, 0.0, -0.6, -0.4, 0.0, 0.0)
        await rig.moved(ELBOW, by_rad=0.005)
        await asyncio.sleep(0.5)  # of the servos' time: bent as far as they will
        bent_rad = rig.joints_rad
        ran = await rig.run("grip", "open", "--yes")
        assert ran.code == 0, ran.said
        links = [0, 1, 2, 4, 5, 6]
        np.testing.assert_allclose(rig.joints_rad[links], bent_rad[links], atol=0.004)


async def test_a_file_is_played_from_where_the_arms_are_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "lift.csv"
    path.write_text("t_s,right.elbow_pitch_deg\n0,130\n0.5,120\n1,110\n", encoding="utf-8")
    async with arms_rig(tmp_path) as rig:
        ran = await rig.run("play", str(path), "--yes")
        assert ran.code == 0, ran.said
        goal_rad = ARMS.stow_rad()
        goal_rad[ELBOW] = np.radians(110.0)
        np.testing.assert_allclose(rig.joints_rad, goal_rad, atol=NEAR_RAD)


async def test_on_a_terminal_it_asks_and_shows_the_servos_while_they_move(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        async with on_terminal(rig, "home") as terminal:
            await terminal.until("move? [y/N]")
            assert "least clearance" in terminal.seen
            terminal.type_in("n\n")
            assert await terminal.ended() == 1
            assert "nothing was moved" in terminal.seen
            assert not any(rig.powered)
        async with on_terminal(rig, "home") as terminal:
            await terminal.until("move? [y/N]")
            terminal.type_in("y\n")
            await terminal.until("age")
            assert await terminal.ended() == 0
            assert "[moving]" in terminal.seen
            assert "done: the arms hold" in terminal.seen
        np.testing.assert_allclose(rig.joints_rad, ARMS.home_rad(), atol=NEAR_RAD)


async def test_arms_that_were_moved_after_the_plan_was_shown_are_not_moved_by_it(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig, on_terminal(rig, "home") as terminal:
        await terminal.until("move? [y/N]")
        rig.alone.load_nm = tuple(-2.0 if joint == ELBOW else 0.0 for joint in range(8))
        await rig.moved(ELBOW)
        rig.alone.load_nm = (0.0,) * 8
        await until(lambda: rig.stands_still)
        there_rad = rig.joints_rad
        terminal.type_in("y\n")
        assert await terminal.ended() == 2
        assert "nothing was moved: right.elbow_pitch is" in terminal.seen
        np.testing.assert_allclose(rig.joints_rad, there_rad, atol=NEAR_RAD)


async def test_the_live_state_runs_until_ctrl_c(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig, on_terminal(rig, "read") as terminal:
        await terminal.until("cycles/s")
        terminal.interrupt()
        assert await terminal.ended() == 0
        assert "Traceback" not in terminal.seen


async def test_ctrl_c_brings_the_arms_to_rest_on_their_way_and_holds_them(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        running = await _on_its_way(rig, "home")
        running.interrupt()
        ran, stand_rad = await _ended(rig, running)
        assert all(rig.powered)
    assert ran.code == 130, ran.said
    assert "interrupted: the arms came to rest on their way and hold" in ran.err
    way = (stand_rad - ARMS.stow_rad())[[0, 1, 4, 5]] / (ARMS.home_rad() - ARMS.stow_rad())[[0, 1, 4, 5]]
    assert 0.1 < way.mean() < 0.99
    np.testing.assert_allclose(way, way.mean(), atol=0.05)  # the way is straight in the joints


async def test_a_servo_that_fails_stops_all_joints_and_is_named(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        running = await _on_its_way(rig, "play", "swing")
        rig.fault(FaultKind.OVERLOAD, 6)
        ran, stand_rad = await _ended(rig, running)
        assert rig.powered == [name != "left.elbow_pitch" for name in JOINT_NAMES]
    assert ran.code == 1, ran.said
    assert "left.elbow_pitch (ID 6) is overloaded" in ran.err
    assert "the arms were stopped and hold where they can" in ran.err
    assert stand_rad[ELBOW] != pytest.approx(ARMS.stow_rad()[ELBOW], abs=0.1)


async def test_a_port_that_is_pulled_out_ends_the_motion_with_its_sentence(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        running = await _on_its_way(rig, "play", "swing")
        rig.fault(FaultKind.PORT_GONE)
        ran, _ = await _ended(rig, running)
    assert ran.code == 1, ran.said
    assert "is gone" in ran.err
    assert "plug its cable in again" in ran.err


async def test_a_program_that_stood_still_does_not_catch_up(tmp_path: Path) -> None:
    async with arms_rig(tmp_path) as rig:
        running = await _on_its_way(rig, "play", "swing")
        running.send(signal.SIGSTOP)
        await until(lambda: rig.stands_still)
        there_rad = rig.joints_rad
        await asyncio.sleep(0.5)
        running.send(signal.SIGCONT)
        ran, stand_rad = await _ended(rig, running)
    assert ran.code == 1, ran.said
    assert "this program stood still for" in ran.err
    np.testing.assert_allclose(stand_rad, there_rad, atol=0.05)
