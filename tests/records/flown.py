"""Ticks of a made-up flight: real estimator, real law, real gate, and a vehicle that follows a circle."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from companion.arms.state_machine import ArmPhase
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.control.pipeline import ControlPipeline, idle_setpoint
from companion.core.types import (
    ArmStatus,
    AttitudeThrust,
    AutopilotStatus,
    FlightMode,
    JointMotion,
    MocapFrame,
    Reference,
)
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.flight.arm_step import ArmTick
from companion.flight.tick import Tick
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import FlightState, Phase

PERIOD_S = 0.01
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ZERO = np.zeros(3)
CONFIG = CompanionConfig()
STATUS = AutopilotStatus(
    connected=True,
    heartbeat_s=-math.inf,
    armed=False,
    mode=FlightMode.HOLD,
    in_air=False,
    battery_fraction=0.9,
    battery_v=16.1,
    q_w_flu_wxyz=LEVEL,
    last_text="",
)
DISK_FULL = Event(Fault.DISK_FULL, '1 MB free, 100 % "full"')


def flight(
    track_s: float = 0.5, after_s: float = 0.1, start_s: float = 100.0, controllers: tuple[str, ...] = ("practical",)
) -> Iterator[Tick]:
    """Yield the ticks of a flight: standby, preflight, track under each controller in turn, disarmed."""
    seed = np.random.default_rng(1)
    estimate, time_s = EstimatorState(), start_s
    stage, sent = None, idle_setpoint(0.0)
    phases = [
        (Phase.STANDBY, "", 10),
        (Phase.PREFLIGHT, "", 10),
        *((Phase.TRACK, name, round(track_s / PERIOD_S)) for name in controllers),
        (Phase.DISARMED, "", round(after_s / PERIOD_S)),
    ]
    number = 0
    for phase, name, ticks in phases:
        if name:
            law = load_controller(name, CONFIG.vehicle_model(), PERIOD_S).law
            if stage is None:
                stage = ControlPipeline(law, CONFIG.vehicle.thrust_model(), CONFIG.limits.limits())
            else:
                stage.switch(law)
        for _ in range(ticks):
            number += 1
            time_s += PERIOD_S
            frame = None
            if number % 7:
                where = np.array([math.cos(time_s), math.sin(time_s), 1.0]) + seed.normal(0.0, 3e-4, 3)
                frame = MocapFrame(
                    frame=number,
                    stamp_s=time_s - 40.0,
                    received_s=time_s - 0.001,
                    position_w_m=where,
                    rotation_w_b=np.eye(3),
                    residual_m=math.nan,
                    late=number // 100,
                )
                estimate = estimator.step(estimate, frame, EstimatorParams())
            tick = _tick(time_s, phase, name, frame, estimate, (stage, sent) if stage and name else None)
            sent = sent if tick.limited is None else tick.limited.setpoint
            yield tick


def _tick(
    time_s: float,
    phase: Phase,
    name: str,
    frame: MocapFrame | None,
    estimate: EstimatorState,
    law: tuple[ControlPipeline, AttitudeThrust] | None,
) -> Tick:
    flown = law is not None and estimate.vehicle is not None
    reference = Reference(np.array([math.cos(time_s), math.sin(time_s), 1.0]), ZERO, ZERO, 0.1)
    output, late = None, {}
    if law is not None and estimate.vehicle is not None:
        stage, sent = law
        output = stage.fly(estimate.vehicle, estimator.age_s(estimate, time_s), reference, sent, PERIOD_S)
        late = stage.settle()
    return Tick(
        time_s=time_s,
        late_s=0.0001,
        frame_received_s=frame.received_s if frame else math.nan,
        sent_s=time_s + 0.0005 if flown else math.nan,
        vehicle=estimate.vehicle,
        age_s=estimator.age_s(estimate, time_s),
        status=replace(STATUS, armed=flown, mode=FlightMode.OFFBOARD if flown else FlightMode.HOLD),
        flight=FlightState(
            phase=phase, airborne=flown, reason="the operator\nwants it" if phase is Phase.DISARMED else ""
        ),
        reference=reference if flown else None,
        pipeline=output,
        limited=output.limited if output else None,
        late_signals=late,
        arms=_arms(time_s),
        events=(DISK_FULL,) if phase is Phase.PREFLIGHT else (),
        frame=frame,
        estimate=estimate,
        law=name or "practical",
    )


def _arms(time_s: float) -> ArmTick:
    joints = np.full(8, 0.1 * math.sin(time_s))
    nothing = np.full(8, np.nan)
    goal = JointMotion(joints, joints, joints)
    status = ArmStatus(
        read_s=np.full(8, -np.inf),
        position_rad=joints,
        velocity_radps=joints,
        effort=nothing,
        temperature_c=nothing,
        voltage_v=nothing,
        torque_on=np.ones(8, bool),
        held_rad=joints,
        faults=(),
        cycles=7,
        cycle_s=0.004,
        bad_packets=1,
    )
    return ArmTick(ArmPhase.HOLDING, "", goal, status, ZERO)
