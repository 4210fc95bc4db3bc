"""The arms' stage on the real driver and a servo bus: what torque that is already there does, before and after."""

import asyncio

import numpy as np
import pytest

from companion.arms.state_machine import ArmPhase
from companion.arms.trajectory import Hold, minimum_jerk
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import ArmError
from companion.flight.arm_step import ArmStep
from companion.supervisor.flight_state import FlightState, Phase
from mock_autopilot.servos.config import FaultKind
from tests.adapters.dynamixel.rig import CLOCK, BusRig, connected, mock_bus

pytestmark = pytest.mark.realtime

STANDING = FlightState(phase=Phase.STANDBY)
HEAVY_NM = (-1.2, -0.6, 0.0, 0.0, -1.2, -0.6, 0.0, 0.0)
"""Weights that bend a joint a few hundredths of a radian away from its goal."""


async def ticked(stage: ArmStep, for_s: float = 0.4) -> ArmPhase:
    """Some cycles of the flight loop's."""
    end_s = CLOCK.now_s() + for_s
    while CLOCK.now_s() < end_s:
        stage.read(CLOCK.now_s(), STANDING)
        stage.tick(CLOCK.now_s(), STANDING)
        await asyncio.sleep(0.01)
    return stage.state.phase


def stage_on(bus: object) -> ArmStep:
    config = CompanionConfig(arms=ArmsConfig())
    assert config.arms is not None
    return ArmStep(bus, config.arms, config.vehicle_model(), config.airframe(), 0.01)  # type: ignore[arg-type]


async def raised(rig: BusRig) -> None:
    """An earlier program leaves the loaded arms up, with torque."""
    async with connected(rig) as bus:
        await bus.torque_on()
        bus.move(np.full(8, 0.4))
        await asyncio.sleep(1.0)


async def test_arms_that_another_program_left_up_are_taken_over_without_sinking() -> None:
    async with mock_bus() as rig:
        rig.load_nm = HEAVY_NM
        await raised(rig)
        before_rad = rig.joints_rad
        async with connected(rig) as bus:
            stage = stage_on(bus)
            assert await ticked(stage) is ArmPhase.OFF, "torque that is not ours"
            await stage.torque_on()
            assert await ticked(stage) is ArmPhase.HOLDING
            assert rig.joints_rad == pytest.approx(before_rad, abs=0.005), "nobody sank, no claw let go"
            assert stage.held_rad is not None
            assert stage.held_rad[0] - rig.joints_rad[0] > 0.01, (
                "held by the goal above, not by where the load bends it"
            )


async def test_a_motion_begins_where_the_goals_are_and_nowhere_else() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        stage = stage_on(bus)
        with pytest.raises(ArmError, match="the arms must hold still first, they are off"):
            stage.play(Hold(np.zeros(8), 1.0), Phase.STANDBY)
        await stage.torque_on()
        await ticked(stage)
        assert stage.held_rad is not None
        with pytest.raises(ArmError, match=r"the motion begins 17 degrees from where .* is held"):
            stage.play(Hold(stage.held_rad + 0.3, 1.0), Phase.STANDBY)
        with pytest.raises(ArmError, match="the arms may not move in flight phase takeoff"):
            stage.play(Hold(stage.held_rad, 1.0), Phase.TAKEOFF)
        stage.play(minimum_jerk(stage.held_rad, stage.held_rad + 0.2, 1.0), Phase.STANDBY)
        assert await ticked(stage, 1.4) is ArmPhase.HOLDING
        assert rig.joints_rad == pytest.approx(np.full(8, 0.2), abs=0.02)


async def test_a_fault_stays_until_it_is_cleared_and_torque_comes_back_on_command_only() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        stage = stage_on(bus)
        await stage.torque_on()
        assert await ticked(stage) is ArmPhase.HOLDING
        rig.fault(FaultKind.OVERLOAD, 6, for_s=0.2)
        assert await ticked(stage) is ArmPhase.FAULT
        assert stage.fault.startswith("left.elbow_pitch")
        await stage.clear_faults()
        assert await ticked(stage) is ArmPhase.OFF, "cleared, but it obeys nobody yet"
        await stage.torque_on()
        assert await ticked(stage) is ArmPhase.HOLDING
