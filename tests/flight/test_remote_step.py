"""A ground law's part of the vehicle's cycle: which command is used, how old it is, and what the ground is told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.control.remote_law import RemoteLaw
from companion.core.types import AttitudeThrust, JointMotion
from companion.flight.remote_step import RemoteStep
from companion.guard.limits import LimitedSetpoint
from companion.law_link.messages import Command, DownFlags, Plan, UpFlags
from companion.law_link.vehicle_end import VehicleEnd
from companion.supervisor.flight_state import FlightState, Leg, Phase
from companion.trajectories.reference import Hold
from tests.law_link.ends import HOVER, KEY, ME, Joined

STANDING = FlightState(phase=Phase.STANDBY)
ARMED = FlightState(phase=Phase.ARMED)
FLYING = FlightState(
    phase=Phase.HOLD, airborne=True, legs=(Leg(Phase.HOLD, Hold(np.array([0.5, 0.0, 1.2]), 0.1)),), leg_start_s=0.0
)
LEVEL = AttitudeThrust(np.array([1.0, 0.0, 0.0, 0.0]), np.array(0.5))
NO = np.array(False)


class Vehicle:
    """Both ends of the link, and the vehicle's cycle at the ground's."""

    def __init__(self) -> None:
        self.joined = Joined()
        self.end = self.joined.vehicle
        self.down: list[bytes] = []
        self.law = RemoteLaw()
        self.step = RemoteStep(self, self.law)

    def send(self, datagram: bytes) -> None:
        """Bring a datagram to the ground."""
        self.down.append(datagram)
        self.joined.ground.hear(datagram, self.joined.now_s)

    def cycle(
        self,
        flight: FlightState,
        command: Command | None = None,
        limited: LimitedSetpoint | None = None,
        sent: AttitudeThrust = LEVEL,
    ) -> None:
        """Run one cycle of the ground and one of the vehicle, 10 ms after the last."""
        self.joined.cycle(command)
        self.step.read(self.joined.now_s, flight)
        self.down.clear()
        self.step.show(self.joined.now_s, flight, sent, limited, None)

    def lift_off(self) -> None:
        """Stand, arm, and fly; the ground law notices."""
        for flight in (STANDING, ARMED, FLYING):
            self.cycle(flight)
        report = self.joined.ground.report
        assert report is not None
        assert report.flags & DownFlags.AIRBORNE
        self.joined.ground.epoch, self.joined.ground.flags = report.epoch, UpFlags.FLYING


class Nobody:
    """Link without a ground law."""

    def __init__(self) -> None:
        self.end = VehicleEnd(KEY, ME, bytes)
        self.sent: list[bytes] = []

    def send(self, datagram: bytes) -> None:
        self.sent.append(datagram)


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def push(x: float, yaw_rad: float = 0.0) -> Command:
    return Command(accel_w_mps2=(x, 0.0, 0.0), yaw_rad=yaw_rad, capture_ago=100)


def test_on_the_ground_and_before_the_first_command_it_hovers_level(vehicle: Vehicle) -> None:
    vehicle.cycle(STANDING)
    assert vehicle.law.command.number == 0
    vehicle.lift_off()
    command = vehicle.law.command
    assert (command.number, command.yaw_rad) == (0, None)
    assert command.accel_w_mps2.tolist() == [0.0, 0.0, 0.0]
    for _ in range(20):
        vehicle.cycle(FLYING)
    assert vehicle.law.command.age_s == pytest.approx(0.2), "beats do not replace a first command"


def test_the_newest_command_is_held_and_confirmed_by_beats(vehicle: Vehicle) -> None:
    vehicle.lift_off()
    vehicle.cycle(FLYING, push(1.0, 0.3))
    for _ in range(10):
        vehicle.cycle(FLYING)
        command = vehicle.law.command
        assert command.accel_w_mps2.tolist() == [1.0, 0.0, 0.0]
        assert command.yaw_rad == pytest.approx(0.3)
        assert command.age_s < 0.035
    vehicle.cycle(FLYING, push(2.0))
    assert vehicle.law.command.accel_w_mps2[0] == 2.0
    assert vehicle.law.command.number == command.number + 1


def test_a_command_of_an_earlier_flight_is_not_used(vehicle: Vehicle) -> None:
    vehicle.lift_off()
    vehicle.cycle(FLYING, push(1.0))
    vehicle.cycle(STANDING)
    assert vehicle.law.command.number == 0
    vehicle.cycle(ARMED)
    for _ in range(20):
        vehicle.cycle(FLYING)  # the ground has not noticed: its beats are still of the flight before
    assert vehicle.law.command.number == 0
    assert vehicle.law.command.accel_w_mps2.tolist() == [0.0, 0.0, 0.0]
    assert vehicle.law.command.age_s == pytest.approx(0.19)


def test_epochs_count_flights_from_1_to_15(vehicle: Vehicle) -> None:
    vehicle.cycle(STANDING)
    assert vehicle.step.tick.epoch == 0
    seen = []
    for _ in range(17):
        vehicle.step.read(vehicle.joined.now_s, FLYING)
        vehicle.step.read(vehicle.joined.now_s, STANDING)
        seen.append(vehicle.step.tick.epoch)
    assert seen == [*range(1, 16), 1, 2]


def test_no_session_begins_while_setpoints_are_sent(vehicle: Vehicle) -> None:
    for flight, locked in ((STANDING, False), (ARMED, True), (FLYING, True)):
        vehicle.cycle(flight)
        assert vehicle.end.locked is locked
    vehicle.cycle(replace(FLYING, phase=Phase.HANDED_OVER))
    assert not vehicle.end.locked


def test_without_a_ground_law_nothing_is_sent_and_everything_is_too_old() -> None:
    nobody = Nobody()
    step = RemoteStep(nobody, RemoteLaw())
    step.read(1.0, FLYING)
    step.show(1.0, FLYING, LEVEL, None, None)
    assert nobody.sent == []
    assert math.isinf(step.tick.command.age_s)
    assert step.law_name == "no law on the ground"


def test_the_law_is_named_after_the_one_on_the_ground(vehicle: Vehicle) -> None:
    vehicle.cycle(STANDING)
    assert vehicle.step.law_name == "etnn on the ground"


def reports(vehicle: Vehicle) -> int:
    return vehicle.joined.ground.counts.reports


def test_a_report_goes_at_once_when_the_setpoint_has_changed_and_else_every_30_ms(vehicle: Vehicle) -> None:
    vehicle.lift_off()
    vehicle.cycle(FLYING)
    before = reports(vehicle)
    for _ in range(32):
        vehicle.cycle(FLYING)
    assert 8 <= reports(vehicle) - before <= 11
    before = reports(vehicle)
    for k in range(10):
        vehicle.cycle(FLYING, sent=AttitudeThrust(LEVEL.q_w_flu_wxyz, np.array(0.6 + 0.01 * k)))
    assert reports(vehicle) - before == 10


@pytest.mark.parametrize("name", ["not_finite", "age_cut", "fence_cut", "tilt_cut", "thrust_cut", "slew_cut"])
def test_the_ground_is_told_what_it_cannot_know_of_the_guard(vehicle: Vehicle, name: str) -> None:
    uncut = LimitedSetpoint(
        setpoint=LEVEL, not_finite=NO, tilt_cut=NO, thrust_cut=NO, slew_cut=NO, age_cut=NO, fence_cut=NO
    )
    vehicle.lift_off()
    vehicle.cycle(FLYING, limited=replace(uncut, **{name: np.array(True)}))  # type: ignore[arg-type]
    report = vehicle.joined.ground.report
    assert report is not None
    assert bool(report.flags & DownFlags.CUT) is (name in {"not_finite", "age_cut", "fence_cut"})


def test_arming_and_phase_are_reported(vehicle: Vehicle) -> None:
    for flight in (STANDING, FlightState(phase=Phase.PREFLIGHT), ARMED, FLYING):
        vehicle.cycle(flight)
        report = vehicle.joined.ground.report
        assert report is not None
        assert bool(report.flags & DownFlags.ARMING) is (flight.phase in {Phase.PREFLIGHT, Phase.ARMED})
        assert list(Phase)[report.phase] is flight.phase


def plan_of(vehicle: Vehicle) -> Plan | None:
    return vehicle.joined.ground.plan


def place(vehicle: Vehicle) -> object:
    plan = plan_of(vehicle)
    return None if plan is None else plan.knots[0].position_w_m


def plans(vehicle: Vehicle, cycles: int) -> int:
    """Return the number of plans that reach the ground in so many cycles."""
    seen = [plan_of(vehicle)]
    for _ in range(cycles):
        vehicle.cycle(FLYING)
        if plan_of(vehicle) is not seen[-1]:
            seen.append(plan_of(vehicle))
    return len(seen) - 1


def test_a_plan_goes_when_it_changes_and_every_200_ms(vehicle: Vehicle) -> None:
    vehicle.cycle(STANDING)
    assert place(vehicle) is None
    vehicle.lift_off()
    assert place(vehicle) == (0.5, 0.0, pytest.approx(1.2))
    assert plans(vehicle, 40) == 2
    vehicle.cycle(replace(FLYING, legs=(Leg(Phase.HOLD, Hold(np.array([0.0, 0.0, 1.0]), 0.0)),)))
    assert place(vehicle) == (0.0, 0.0, 1.0), "another hover in the same phase"


def test_a_link_that_loses_messages_gets_plans_more_often(vehicle: Vehicle) -> None:
    vehicle.lift_off()
    for _ in range(30):
        vehicle.joined.sent()  # and lost
    assert plans(vehicle, 40) >= 7


def test_a_plan_has_the_motion_of_the_arms(vehicle: Vehicle) -> None:
    def joints_at(time_s: float) -> JointMotion:
        return JointMotion(np.full(8, time_s), np.full(8, 1.0), np.zeros(8))

    vehicle.lift_off()
    moved = replace(FLYING, leg_start_s=0.01)
    vehicle.step.show(5.0, moved, LEVEL, None, joints_at)
    plan = vehicle.joined.ground.plan
    assert plan is not None
    assert plan.knots[1].joints[:9] == pytest.approx([5.2] * 8 + [1.0])


def test_a_question_is_sent_again_until_it_is_answered(vehicle: Vehicle) -> None:
    vehicle.cycle(STANDING)
    vehicle.end.ask("which law?", vehicle.joined.now_s)
    vehicle.cycle(STANDING)
    asked = vehicle.joined.ground.asked
    assert asked is not None
    assert asked.text == "which law?"
    vehicle.joined.ground.answer(asked, "etnn")
    for _ in range(3):
        vehicle.cycle(STANDING)
    assert vehicle.end.answers == ["etnn"]


def test_the_law_gives_the_command_in_use_and_calls_a_new_one_an_event(vehicle: Vehicle) -> None:
    vehicle.lift_off()
    memory = vehicle.law.initial(None)  # type: ignore[arg-type]
    vehicle.cycle(FLYING, HOVER)
    memory, output = vehicle.law.step(memory, None)  # type: ignore[arg-type]
    assert (output.event.item(), output.yaw_rad) == (1.0, 0.0)
    assert output.age_s == vehicle.law.command.age_s
    _, again = vehicle.law.step(memory, None)  # type: ignore[arg-type]
    assert again.event.item() == 0.0
