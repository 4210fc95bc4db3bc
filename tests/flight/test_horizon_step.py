"""Correction of the horizon by motion capture: when the loop allows it, and what it says when the two are far apart."""

import math
from dataclasses import replace
from typing import Any, Never

import numpy as np
import pytest

from companion.control.horizon_correction import HorizonRules
from companion.control.wire_setpoint import WireSetpoint
from companion.core.types import AttitudeThrust, AutopilotStatus, VehicleState
from companion.estimation.estimator import EstimatorState, Verdict
from companion.flight.horizon_step import HorizonStep
from companion.flight.setpoint_stream import SetpointStream
from companion.geometry.frames import quat_from_rotation_vector
from companion.guard.limits import Limits
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import FlightState, Phase
from companion.supervisor.safety_rules import SafetyRules
from tests.supervisor.observing import healthy

PERIOD_S = 0.01
RULES = HorizonRules()
HOVER = AttitudeThrust(np.array([1.0, 0.0, 0.0, 0.0]), np.array(0.5))
FLYING = FlightState(phase=Phase.HOLD, airborne=True)
"""In the air."""
OFF_RAD = 0.03


class _Autopilot:
    """Takes setpoints."""

    def __init__(self) -> None:
        self.sent: list[AttitudeThrust] = []

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        self.sent.append(setpoint)


class Loop:
    """A flight loop's cycle, as far as the setpoint goes."""

    def __init__(self, off_rad: float = OFF_RAD) -> None:
        self.autopilot, limits, safety = _Autopilot(), Limits(), SafetyRules()
        self.stream = SetpointStream(self.autopilot, _Nobody(), _Nobody(), 1.0)  # type: ignore[arg-type]
        self.wire_stage = WireSetpoint(RULES, limits)
        cap_rad = float(RULES.cap_rad)
        self.stage = HorizonStep(self.wire_stage, self.stream, safety, cap_rad, 0.002, PERIOD_S)
        self.now_s, self.off_rad = 100.0, off_rad
        self.correction_rad = math.nan

    def fly(self, time_s: float, *faults: Fault, flight: FlightState = FLYING, **changes: Any) -> float:
        """Go on for a time; the correction of roll at its end."""
        for _ in range(round(time_s / PERIOD_S)):
            self.now_s += PERIOD_S
            q = quat_from_rotation_vector(np.array([self.off_rad, 0.0, 0.0]))
            vehicle = VehicleState(self.now_s - 0.01, np.zeros(3), np.zeros(3), q, np.zeros(3))
            estimate = EstimatorState(vehicle=vehicle, verdict=changes.get("verdict", Verdict.ACCEPTED))
            status: AutopilotStatus = replace(healthy(0).autopilot, attitude_s=self.now_s)
            events = [Event(fault, "") for fault in faults]
            wire = self.stage.correct(HOVER, estimate, status, events, flight, self.now_s)
            self.stage.judge(wire)
            self.stream.send(HOVER, None if wire is None else wire.setpoint)
            self.correction_rad = math.nan if wire is None else float(wire.horizon.x)
        return self.correction_rad


class _Nobody:
    """Clock and watchdog timer."""

    def now_s(self) -> float:
        return 0.0

    def renew(self) -> None:
        pass

    def release(self) -> None:
        pass


def test_it_corrects_in_flight_and_what_the_law_knows_as_sent_stays_the_laws() -> None:
    loop = Loop()
    assert loop.fly(6.0) == pytest.approx(OFF_RAD, abs=1e-3)
    assert loop.stream.sent is HOVER
    assert loop.stream.wire is loop.autopilot.sent[-1]
    assert len(loop.autopilot.sent) < 6
    assert loop.stage.fault == ""


@pytest.mark.parametrize(
    "fault", [Fault.ATTITUDE_DISAGREES, Fault.HORIZON_WRONG, Fault.HEADING_DISAGREES, Fault.MOCAP_JUMPED]
)
def test_what_casts_doubt_on_either_attitude_ends_the_correction(fault: Fault) -> None:
    loop = Loop()
    loop.fly(6.0)
    assert loop.fly(1.0, fault) == 0.0
    assert loop.fly(6.0) == pytest.approx(OFF_RAD, abs=1e-3)
    assert loop.fly(1.0, Fault.BATTERY_LOW) > 0.9 * OFF_RAD


def test_after_the_estimator_began_anew_and_on_the_ground_it_waits() -> None:
    loop = Loop()
    loop.fly(6.0)
    loop.fly(PERIOD_S, verdict=Verdict.STARTED)
    assert loop.fly(0.3) < OFF_RAD - 0.02
    assert loop.fly(1.0, flight=replace(FLYING, airborne=False)) == 0.0
    assert loop.fly(1.0) > 0.9 * OFF_RAD, "compared on the ground, corrected from lift-off on"


def test_beyond_the_cap_for_two_seconds_it_says_what_to_do() -> None:
    loop = Loop(off_rad=0.11)
    loop.fly(1.9)
    assert loop.stage.fault == ""
    loop.fly(2.5)
    assert loop.stage.fault.startswith("the autopilot's horizon is 6.3 degrees off motion capture's for ")
    assert "check the rigid body's axes in QTM" in loop.stage.fault
    loop.fly(0.5, flight=replace(FLYING, airborne=False))
    assert loop.stage.fault == ""


def test_without_a_pose_nothing_is_corrected() -> None:
    loop = Loop()
    assert loop.stage.correct(HOVER, EstimatorState(), healthy(0).autopilot, (), FLYING, 1.0) is None


def test_what_fails_in_it_lets_the_laws_setpoint_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> Never:
        raise ZeroDivisionError

    loop = Loop()
    loop.fly(6.0)
    monkeypatch.setattr(loop.wire_stage, "put", fail)
    loop.fly(0.1)
    assert loop.autopilot.sent[-1] is HOVER
    monkeypatch.undo()
    loop.fly(1.0)
    assert math.isnan(loop.correction_rad), "not tried again in this flight"
    loop.stage.reset()
    assert loop.fly(6.0) == pytest.approx(OFF_RAD, abs=1e-3)
