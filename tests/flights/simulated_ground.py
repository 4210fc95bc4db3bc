"""A law on the ground in simulated time: it has the frames, and the vehicle gets commands and poses, some time later.

What the link makes of them, and how it is lost, is not here: only a radio that delays, and a law that may die.
"""

import math
from collections import deque
from typing import Protocol

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.control.controller import ControlInput, ControlOutput
from companion.control.pipeline import ControlPipeline
from companion.core.types import Array, GroundPose, MocapFrame
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.flight.flight_loop import FlightLoop
from companion.geometry.frames import yaw_of
from companion.supervisor.state_machine import reference_at


class Room(Protocol):
    """The room, as far as the ground sees it."""

    frame: MocapFrame | None
    new_frame: bool

    def now_s(self) -> float: ...

    def pass_time(self, for_s: float) -> None: ...


PERIOD_S = 0.01


class SimulatedGround:
    """Law on the ground and its radio: interfaces.GroundPoses, and the vehicle's Controller."""

    preview_s = 0.0

    def __init__(self, config: CompanionConfig, radio_s: float = 0.01, law: str = "etnn") -> None:
        model, limits = config.vehicle.thrust_model(), config.limits.limits()
        self._pipeline = ControlPipeline(load_controller(law, config.vehicle_model(), PERIOD_S).law, model, limits)
        self._estimate, self._params = EstimatorState(), EstimatorParams(delay_s=config.mocap.delay_s)
        self.radio_s = radio_s
        self.dead_at_s = math.inf
        """From then on nothing leaves the ground."""
        self.beat_s = 0.03
        """Period of its messages; each law's event comes at once."""
        self._sent_s = -math.inf
        self._on_the_way: deque[tuple[float, GroundPose, Array | None]] = deque()
        self._pose: GroundPose | None = None
        self._accel: Array = np.zeros(3)
        self._number = 0
        self.arrived_s = -math.inf
        """Arrival of the newest message."""
        self.loop: FlightLoop | None = None

    # -- on the ground ---------------------------------------------------------------------------

    def see(self, frame: MocapFrame, now_s: float) -> None:
        """Estimate, run the law as the vehicle's flight asks for, and send."""
        self._estimate = estimator.step(self._estimate, frame, self._params)
        vehicle = self._estimate.vehicle
        if vehicle is None or self.loop is None or now_s >= self.dead_at_s:
            return
        accel = self._command(now_s)
        if accel is None and now_s - self._sent_s < self.beat_s - 1e-9:
            return
        self._sent_s = now_s
        at = vehicle.position_w_m.round(3), round(float(yaw_of(vehicle.q_w_flu_wxyz)), 4)
        pose = GroundPose(time_s=vehicle.time_s, position_w_m=at[0], yaw_rad=at[1])
        self._on_the_way.append((now_s + self.radio_s, pose, accel))

    def _command(self, now_s: float) -> Array | None:
        """Return the law's acceleration if it is worth sending; None while the vehicle is not in the air."""
        assert self.loop is not None
        vehicle, flight = self._estimate.vehicle, self.loop.flight
        assert vehicle is not None
        if not flight.airborne:
            self._pipeline.forget()
            return None
        arrives_s = now_s + self.radio_s
        ahead = reference_at(flight, arrives_s + self._pipeline.preview_s)
        sent = self.loop._stream.law_sent  # noqa: SLF001 - what the downlink tells
        output = self._pipeline.fly(vehicle, arrives_s - vehicle.time_s, ahead, sent, PERIOD_S).law_output
        self._pipeline.settle()
        return output.accel_w_mps2 if output.event.any() else None

    def pass_time(self, room: Room, for_s: float) -> None:
        """Let time pass in the room; the ground sees each frame."""
        end_s = room.now_s() + for_s
        while True:
            room.pass_time(end_s - room.now_s())
            if room.new_frame and room.frame is not None:
                room.new_frame = False
                self.see(room.frame, room.now_s())
            self.receive(room.now_s())
            if room.now_s() >= end_s - 1e-9:
                return

    # -- on the vehicle --------------------------------------------------------------------------

    def receive(self, now_s: float) -> None:
        """Take what has arrived by now."""
        while self._on_the_way and self._on_the_way[0][0] <= now_s:
            self.arrived_s, self._pose, accel = self._on_the_way.popleft()
            if accel is not None:
                self._accel, self._number = accel, self._number + 1

    def latest_pose(self) -> GroundPose | None:
        return self._pose

    def initial(self, first: ControlInput) -> int:  # noqa: ARG002 - the interface of a law
        self._accel = np.zeros(3)
        return self._number

    def step(self, memory: int, now: ControlInput) -> tuple[int, ControlOutput]:  # noqa: ARG002 - the interface of a law
        return self._number, ControlOutput(self._accel, np.array([float(self._number != memory)]), {})
