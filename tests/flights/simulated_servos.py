"""The arms' bus in simulated time: the mock's servos behind the port, without a pseudo-terminal."""

from typing import TYPE_CHECKING

import numpy as np

from companion.arms.model import JOINT_COUNT, JOINT_NAMES
from companion.config.arms_config import ArmsConfig
from companion.core.types import ArmFault, ArmFaultKind, ArmStatus, Array

if TYPE_CHECKING:
    from tests.flights.simulated import Room


class SimulatedServos:
    """ports.ArmBus."""

    def __init__(self, room: "Room") -> None:
        assert room.bench.world.arms is not None
        assert room.bench.world.servos is not None
        self._room, self._rack = room, room.bench.world.servos
        self._arms = room.bench.world.arms
        servos = [ArmsConfig().servos[name] for name in JOINT_NAMES]
        self._sign = np.array([servo.direction for servo in servos])
        self._zero_rad = np.array([servo.zero_rad for servo in servos])
        self._faults: tuple[ArmFault, ...] = ()
        self._read_s = -np.inf
        self.hung = False
        """Nothing is read or sent any more."""
        self.holds = 0
        """Number of times that all servos were told to stop."""
        self.goals_rad: list[Array] = []
        self._last: ArmStatus | None = None

    def fail(self, joint: str) -> None:
        """Report an overload of this joint from now on."""
        self._faults = (ArmFault(joint, ArmFaultKind.OVERLOAD, f"{joint} (servo 6): overload"),)

    def status(self) -> ArmStatus:
        if self.hung and self._last is not None:
            return self._last
        angle, rate, _ = self._rack.motion()
        nothing, now_s = np.zeros(JOINT_COUNT), self._room.now_s()
        powered = np.array([servo.motor.powered for servo in self._rack.servos])
        goal = np.array([servo.motor.goal_rad for servo in self._rack.servos])
        self._last = ArmStatus(
            read_s=np.full(JOINT_COUNT, now_s),
            position_rad=self._sign * (np.array(angle) - self._zero_rad),
            velocity_radps=self._sign * np.array(rate),
            effort=nothing,
            temperature_c=nothing,
            voltage_v=nothing,
            torque_on=powered,
            held_rad=np.where(powered, self._sign * (goal - self._zero_rad), np.nan),
            faults=self._faults,
            cycles=len(self.goals_rad),
            cycle_s=0.003,
            bad_packets=0,
        )
        return self._last

    def move(self, position_rad: Array) -> None:
        self.goals_rad.append(position_rad)
        for servo, goal in zip(self._rack.servos, self._sign * position_rad + self._zero_rad, strict=True):
            servo.motor.go_to(float(goal))

    def hold(self) -> None:
        self.holds += 1
        for servo in self._rack.servos:
            servo.motor.go_to(servo.motor.goal_rad)

    async def torque_on(self) -> None:
        for servo in self._rack.servos:
            servo.motor.go_to(servo.motor.angle_rad)
            servo.motor.power(on=True)

    async def torque_off(self) -> None:
        for servo in self._rack.servos:
            servo.motor.power(on=False)

    async def clear_faults(self) -> None:
        self._faults = ()
