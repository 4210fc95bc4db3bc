"""The feed-forward of the arms in virtual time equals that of the arms' step in flight."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from companion.arms.planning import Plan, plan
from companion.arms.trajectory import Hold
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.config.companion_config import CompanionConfig
from companion.core.types import ArmStatus, Array
from companion.flight.arm_step import ArmStep
from companion.simulation.scene import arm_feedforward_b_mps2
from companion.supervisor.flight_state import FlightState, Phase

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
PERIOD_S = 0.01
STAND_S = 10.0
"""By then the autopilot, with its 0.75 s, has trimmed out what the pose at the start costs, but for 2e-6 of it."""
HOVERING = FlightState(phase=Phase.HOLD, airborne=True)
ARMS = ArmsConfig()


@dataclass
class ObedientBus:
    """ports.ArmBus: joints that are where they are asked to be, at once."""

    position_rad: Array = field(default_factory=ARMS.stow_rad)
    now_s: float = 0.0

    def status(self) -> ArmStatus:
        nothing, on = np.zeros(8), np.ones(8, dtype=bool)
        at, read_s = self.position_rad, np.full(8, self.now_s)
        return ArmStatus(
            read_s=read_s,
            position_rad=at,
            velocity_radps=nothing,
            effort=nothing,
            temperature_c=nothing,
            voltage_v=nothing,
            torque_on=on,
            held_rad=at,
            faults=(),
            cycles=1,
            cycle_s=0.002,
            bad_packets=0,
        )

    def move(self, position_rad: Array) -> None:
        self.position_rad = position_rad

    def hold(self) -> None:
        pass

    async def torque_on(self) -> None:
        pass

    async def torque_off(self) -> None:
        pass

    async def clear_faults(self) -> None:
        pass


def swing() -> Plan:
    model, start = ARMS.model(), ARMS.stow_rad()
    return plan(model, motion_named("swing", 6.0).trajectory(model, start), start, via_rad=(ARMS.home_rad(),))


def told_in_flight(config: CompanionConfig, arms: ArmsConfig, motion: Plan, cycles: int) -> Array:
    """Cycle by cycle, from the one after that in which the motion began: (cycles - 1, 3)."""
    bus = ObedientBus()
    stage = ArmStep(bus, arms, config.vehicle_model(), config.airframe(), PERIOD_S)
    stands = round(STAND_S / PERIOD_S)
    told = []
    for cycle in range(stands + cycles):
        bus.now_s = cycle * PERIOD_S
        stage.read(bus.now_s, HOVERING)
        if cycle == stands:
            stage.play(motion.trajectory, Phase.HOLD)
        told.append(stage.known_accel_w_mps2(LEVEL))
        stage.tick(bus.now_s, HOVERING)
    return np.array(told[stands + 1 :])


@pytest.mark.parametrize("feedforward", list(Feedforward))
def test_a_whole_flight_at_once_is_what_the_arms_stage_says_cycle_by_cycle(feedforward: Feedforward) -> None:
    config = CompanionConfig(arms=ARMS)
    arms, motion, cycles = ARMS.model_copy(update={"feedforward": feedforward}), swing(), 700
    flown = told_in_flight(config, arms, motion, cycles)
    at_once = arm_feedforward_b_mps2(config, arms, motion.trajectory, PERIOD_S * np.arange(float(cycles)))
    assert at_once.shape == (cycles, 3)
    largest = float(np.abs(flown).max())
    assert (largest > 0.0) == (feedforward is not Feedforward.OFF)
    assert np.abs(at_once[1:] - flown).max() <= 1e-5 * largest


def test_arms_that_stand_push_nobody() -> None:
    config = CompanionConfig(arms=ARMS)
    push = arm_feedforward_b_mps2(config, ARMS, Hold(ARMS.stow_rad(), 5.0), PERIOD_S * np.arange(100.0))
    assert np.abs(push).max() < 1e-12
