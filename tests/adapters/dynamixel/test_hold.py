"""Holding over a pty: goals come to rest where they were going, and what is held stays held."""

from itertools import pairwise

import numpy as np
import pytest

from companion.adapters.dynamixel.bus import DynamixelBus
from companion.core.types import Array
from mock_autopilot.servos.config import FaultKind
from tests.adapters.dynamixel.rig import CLOCK, BusRig, connected, cycles, fault_of, mock_bus, servos, until

pytestmark = pytest.mark.realtime

TICK_RAD = 2.0 * np.pi / 4096.0
AX_TICK_RAD = np.radians(300.0 / 1023.0)
LONGEST_BRAKING_RAD = (1.2 * 3.0) ** 2 / (2.0 * 20.0)
"""Longest braking of an XM's goals, which are no faster than 1.2 times the joint's limit."""
HELD_RAD = np.array([0.4, 0.6, -0.2, 0.3, 0.3, 0.5, 0.1, 0.3])
CLAWS = [3, 7]


class Stream:
    """Goals of the shoulders that go up steadily, a new one whenever it is asked whether something holds by now."""

    def __init__(self, bus: DynamixelBus, velocity_radps: float, end_rad: float) -> None:
        self._bus, self._velocity_radps, self._end_rad = bus, velocity_radps, end_rad
        self._began_s = CLOCK.now_s()
        self.last_rad = 0.0

    def send(self) -> bool:
        self.last_rad = min(self._velocity_radps * (CLOCK.now_s() - self._began_s), self._end_rad)
        self._bus.move(np.array([self.last_rad, *[np.nan] * 3] * 2))
        return True


def goals_rad(rig: BusRig, servo_id: int) -> Array:
    return TICK_RAD * np.array(rig.goals_sent(servo_id)) - np.pi


async def at_rest(rig: BusRig, bus: DynamixelBus) -> None:
    """Wait until goals and joints are at rest."""
    await cycles(bus, 25)
    await until(lambda: abs(bus.status().position_rad - bus.status().held_rad)[:3].max() < 2.0 * TICK_RAD)
    await until(lambda: not any(rig.bus.servos.motion()[1]))


async def test_hold_stops_moving_arms_a_little_further_on_and_they_stay() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        stream = Stream(bus, 1.0, 1.4)
        await until(lambda: stream.send() and rig.joints_rad[0] > 0.3)
        bus.hold()
        await at_rest(rig, bus)
        for servo_id in (1, 5):
            goals = goals_rad(rig, servo_id)
            assert all(later >= before for before, later in pairwise(goals))
            assert goals[-1] <= stream.last_rad + LONGEST_BRAKING_RAD + TICK_RAD
        stopped_rad = rig.joints_rad
        bus.hold()
        await cycles(bus, 20)
        assert rig.joints_rad == pytest.approx(stopped_rad, abs=1e-6)
        assert bus.status().torque_on.all()


async def test_a_joint_whose_reading_is_old_is_not_sent_back_to_where_it_was_seen() -> None:
    async with mock_bus() as rig, connected(rig, silent_s=2.0) as bus:
        await bus.torque_on()
        stream = Stream(bus, 2.0, 1.4)
        await until(lambda: stream.send() and rig.joints_rad[0] > 0.3)
        rig.fault(FaultKind.LATE, 1, late_s=0.05)
        await until(lambda: stream.send() and bus.status().held_rad[0] - bus.status().position_rad[0] > 0.25)
        bus.hold()
        await cycles(bus, 20)
        goals = goals_rad(rig, 1)
        assert all(later >= before for before, later in pairwise(goals))
        assert bus.status().faults == ()


async def test_claws_that_grip_and_joints_that_are_bent_keep_their_goals_when_another_joint_fails() -> None:
    """A claw that grips is one that its load keeps from its goal, by far more than a joint."""
    async with mock_bus() as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(HELD_RAD)
        await until(lambda: abs(rig.joints_rad - HELD_RAD).max() < 3.0 * AX_TICK_RAD)
        rig.load_nm = (-0.8, -0.8, -0.8, 0.9) * 2
        await until(lambda: (bus.status().position_rad - HELD_RAD)[CLAWS].min() > 0.09)
        await until(lambda: not any(rig.bus.servos.motion()[1]))
        bent_rad, goals = rig.joints_rad, [rig.goals_sent(servo_id)[-1] for servo_id in range(1, 9)]
        assert (HELD_RAD - bent_rad)[:3].min() > 0.03
        rig.fault(FaultKind.OVERLOAD, 6)
        await fault_of(bus, "left.elbow_pitch")
        rig.packets.clear()
        bus.hold()
        await cycles(bus, 20)
        for servo_id in (1, 2, 3, 4, 5, 7, 8):
            assert set(rig.goals_sent(servo_id)) == {goals[servo_id - 1]}
        assert np.delete(rig.joints_rad - bent_rad, 5) == pytest.approx(np.zeros(7), abs=1e-3)
        assert np.delete(bus.status().held_rad - HELD_RAD, 5) == pytest.approx(np.zeros(7), abs=1e-9)


async def test_holding_again_and_again_does_not_let_a_loaded_joint_creep() -> None:
    async with mock_bus() as rig, connected(rig) as bus:
        rig.load_nm = (-0.8,) * 3 + (-0.1,) + (-0.8,) * 3 + (-0.1,)
        await bus.torque_on()
        bus.hold()
        await cycles(bus, 25)
        sagged_rad = rig.joints_rad
        for _ in range(12):
            bus.move(np.full(8, np.nan))
            bus.hold()
            await cycles(bus, 2)
        assert rig.joints_rad == pytest.approx(sagged_rad, abs=2 * AX_TICK_RAD)


async def test_a_joint_found_a_little_beyond_its_limit_stays_there_until_it_is_led_in() -> None:
    async with mock_bus(servos=servos(id1={"start_position_rad": np.pi + 1.61})) as rig, connected(rig) as bus:
        await bus.torque_on()
        bus.move(bus.status().held_rad)
        await cycles(bus, 10)
        bus.hold()
        await cycles(bus, 10)
        assert goals_rad(rig, 1) == pytest.approx(1.61, abs=TICK_RAD)
        assert rig.strayed_rad[0] < TICK_RAD
        bus.move(np.full(8, 1.0))
        await until(lambda: abs(rig.joints_rad[0] - 1.0) < 3.0 * TICK_RAD)
        assert abs(np.diff(goals_rad(rig, 1))).max() <= 1.2 * 3.0 * 0.05 + TICK_RAD
