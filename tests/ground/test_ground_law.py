"""One cycle of the law on the ground: when it computes, what it sends, and what it says when it cannot."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.control.controller import ControlInput, ControlOutput
from companion.core.types import MocapFrame, Reference
from companion.ground.ground_law import GroundLaw
from companion.ground.ground_service import parts_of
from companion.ground.ground_tick import GroundTick
from companion.law_link.messages import UpFlags
from companion.law_link.plan import plan_of
from companion.supervisor.flight_state import Phase
from tests.flights.simulated_ground import ground_config
from tests.law_link.ends import Joined, shown

PHASES = tuple(Phase)
CONFIG = CompanionConfig()


class Scripted:
    """Law whose output a test sets."""

    preview_s = 0.0

    def __init__(self) -> None:
        self.accel, self.event, self.error = np.zeros(3), 0.0, ""
        self.yaw_rad: float | None = None
        self.given: list[ControlInput] = []
        self.begun = 0

    def initial(self, first: ControlInput) -> int:  # noqa: ARG002
        self.begun += 1
        return 0

    def step(self, memory: int, now: ControlInput) -> tuple[int, ControlOutput]:
        if self.error:
            raise ZeroDivisionError(self.error)
        self.given.append(now)
        event = np.array([self.event])
        return memory, ControlOutput(accel_w_mps2=self.accel, event=event, signals={}, yaw_rad=self.yaw_rad)


class Ground:
    """The ground law with a vehicle that it is joined to; its clock is 5 s behind the vehicle's."""

    def __init__(self, config: CompanionConfig = CONFIG) -> None:
        self.joined, self.scripted = Joined(offset_s=-5.0), Scripted()
        self.law = GroundLaw(self.joined.ground, parts_of(config), "scripted", self.scripted)
        self.scripted.given.clear()
        self.scripted.begun = 0
        self.place, self.yaw_rad, self.speed_mps = np.array([0.5, 0.0, 1.2]), 0.0, 0.0
        self.frames = 0

    @property
    def now_s(self) -> float:
        return self.joined.now_s + self.joined.offset_s

    def cycle(self, sees: bool = True) -> GroundTick:
        """Run one cycle, 10 ms after the last, and bring its messages to the vehicle."""
        self.joined.now_s += 0.01
        self.place = self.place + 0.01 * np.array([self.speed_mps, 0.0, 0.0])
        if sees:
            self.frames += 1
            noise = 1e-6 * self.frames  # no two frames are the same to the last bit
            seen = self.place + np.array([noise, 0.0, 0.0])
            frame = MocapFrame(
                frame=self.frames,
                stamp_s=self.now_s,
                received_s=self.now_s,
                position_w_m=seen,
                rotation_w_b=np.eye(3),
                residual_m=0.001,
            )
            self.law.take(frame)
        tick = self.law.tick(self.now_s, 0.01)
        self.joined.deliver(self.joined.ground.tick(self.now_s))
        self.law.settle()
        return tick

    def plan(self) -> None:
        """Let the vehicle send its plan: a hover."""

        def hover(_: float) -> Reference:
            return Reference(np.array([0.5, 0.0, 1.2]), np.zeros(3), np.zeros(3), self.yaw_rad)

        datagram = self.joined.vehicle.plan(plan_of(self.joined.now_s, hover, None))
        assert datagram is not None
        self.joined.ground.hear(datagram, self.now_s)

    def lift_off(self, epoch: int = 1) -> None:
        """See the vehicle, and let it report a flight."""
        for _ in range(5):
            self.cycle()
        self.plan()
        self.report(epoch=epoch)

    def report(self, **changes: Any) -> None:
        """Let the vehicle report that it flies, with changes."""
        state = replace(shown(self.joined.ground.newest_number, epoch=1), phase=PHASES.index(Phase.HOLD))
        self.joined.report(replace(state, **changes))


@pytest.fixture
def ground() -> Ground:
    return Ground()


def test_on_the_ground_it_says_whether_it_sees_and_computes_nothing(ground: Ground) -> None:
    assert ground.cycle(sees=False).flags == UpFlags.BLIND
    tick = ground.cycle()
    assert (tick.flags, tick.flying, tick.flown) == (UpFlags(0), False, None)
    assert ground.scripted.given == []


def test_in_flight_every_cycle_computes_for_the_arrival_of_its_command(ground: Ground) -> None:
    ground.lift_off()
    tick = ground.cycle()
    assert (tick.flags, tick.epoch) == (UpFlags.FLYING, 1)
    assert tick.vehicle_s == pytest.approx(ground.joined.now_s + CONFIG.law.link.delay_s)
    [given] = ground.scripted.given
    assert given.age_s == pytest.approx(tick.age_s + CONFIG.law.link.delay_s)
    assert tick.flown is not None
    assert tick.flown.reference.position_w_m == pytest.approx([0.5, 0.0, 1.2])


def test_a_command_goes_at_an_event_and_where_the_heading_has_turned(ground: Ground) -> None:
    def sends() -> bool:
        tick = ground.cycle()
        assert tick.flown is not None
        return tick.flown.sent is not None

    ground.lift_off()
    assert sends(), "the first heading is a new one"
    assert not sends()
    ground.scripted.event, ground.scripted.accel = 1.0, np.array([0.5, 0.0, 0.25])
    assert sends()
    held = ground.joined.vehicle.use(ground.joined.now_s)
    assert held is not None
    assert held.command.accel_w_mps2 == (0.5, 0.0, 0.25)
    ground.scripted.event = 0.0
    assert not sends()
    for turn_rad, wanted in ((0.019, False), (0.03, True)):
        ground.yaw_rad = turn_rad
        ground.plan()
        assert sends() is wanted


def test_a_heading_of_the_laws_own_is_what_crosses(ground: Ground) -> None:
    ground.scripted.yaw_rad = 0.25
    ground.lift_off()
    ground.cycle()
    held = ground.joined.vehicle.use(ground.joined.now_s)
    assert held is not None
    assert held.command.yaw_rad == 0.25


def test_an_event_without_a_finite_command_is_sent_as_soon_as_there_is_one(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    ground.scripted.event, ground.scripted.accel = 1.0, np.full(3, math.nan)
    tick = ground.cycle()
    assert tick.flown is not None
    assert tick.flown.sent is None
    ground.scripted.event, ground.scripted.accel = 0.0, np.array([0.5, 0.0, 0.0])
    tick = ground.cycle()
    assert tick.flown is not None
    assert tick.flown.sent is not None
    assert tick.flown.sent.accel_w_mps2 == (0.5, 0.0, 0.0)


def test_without_a_frame_it_computes_for_50_ms_and_then_is_blind(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    flags = [ground.cycle(sees=False).flags for _ in range(8)]
    assert flags == [UpFlags.FLYING] * 4 + [UpFlags.FLYING | UpFlags.BLIND] * 4, "a frame is 10 ms old when it comes"
    assert len(ground.scripted.given) == 5
    assert ground.cycle().flags == UpFlags.FLYING, "it sees again"


def test_without_a_plan_it_is_blind(ground: Ground) -> None:
    for _ in range(5):
        ground.cycle()
    ground.report()
    assert ground.cycle().flags == UpFlags.FLYING | UpFlags.BLIND
    ground.plan()
    flags = [ground.cycle().flags for _ in range(100)]
    assert flags == [UpFlags.FLYING] * 89 + [UpFlags.FLYING | UpFlags.BLIND] * 11, "0.6 s of plan, 0.3 s beyond"


def test_a_law_that_raises_is_told_and_not_asked_again(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    ground.scripted.error = "a mistake"
    tick = ground.cycle()
    assert tick.flags == UpFlags.FLYING | UpFlags.FAILED
    assert tick.flown is None
    assert tick.failure == "the control law failed: ZeroDivisionError: a mistake"
    ground.scripted.error = ""
    computed = len(ground.scripted.given)
    for _ in range(3):
        assert ground.cycle().flags == UpFlags.FLYING | UpFlags.FAILED
    assert ground.joined.vehicle.status(ground.joined.now_s).failed, "with the next beat"
    assert len(ground.scripted.given) == computed


def test_a_law_without_finite_commands_is_told_after_20_cycles(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    ground.scripted.accel, ground.scripted.event = np.array([np.nan, 0.0, 0.0]), 1.0
    ticks = [ground.cycle() for _ in range(22)]
    assert all(tick.flown is None or tick.flown.sent is None for tick in ticks)
    assert [not tick.failure for tick in ticks] == [True] * 20 + [False] * 2
    assert ticks[-1].failure == "the control law gave no finite command for 20 cycles"
    ground.scripted.accel = np.zeros(3)


def test_a_few_commands_that_are_not_finite_are_forgiven(ground: Ground) -> None:
    ground.lift_off()
    for k in range(100):
        ground.scripted.accel = np.zeros(3) if k % 20 == 19 else np.full(3, np.nan)
        assert not ground.cycle().failure


def test_every_flight_begins_anew(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    ground.scripted.error = "a mistake"
    ground.cycle()
    ground.scripted.error = ""
    ground.report(airborne=False)
    assert not ground.cycle().flying
    assert ground.scripted.begun == 1
    ground.plan()
    ground.report(epoch=2)
    tick = ground.cycle()
    assert (tick.flags, tick.epoch, tick.failure) == (UpFlags.FLYING, 2, "")
    assert ground.scripted.begun == 2
    ground.plan()
    ground.report(epoch=3)
    assert ground.cycle().epoch == 3, "also if the report of its end was lost"
    assert ground.scripted.begun == 3


def test_the_setpoint_sent_last_is_its_own_copy_unless_the_guard_has_cut(ground: Ground) -> None:
    ground.lift_off()
    ground.cycle()
    ground.report(thrust=0.3)
    ground.cycle()
    assert ground.scripted.given[-1].sent_accel_w_mps2[2] == pytest.approx(
        ground.scripted.given[0].sent_accel_w_mps2[2], abs=3.0
    )
    own = ground.cycle()
    ground.report(thrust=0.3, cut=True)
    cut = ground.cycle()
    assert own.flown is not None
    assert cut.flown is not None
    assert float(own.flown.mirror.thrust) > 0.4
    assert float(cut.flown.mirror.thrust) == pytest.approx(0.3)


def test_another_law_has_another_number(ground: Ground) -> None:
    other = Scripted()
    ground.lift_off()
    ground.cycle()
    ground.law.switch("other", other)
    assert ground.cycle().law == "other"
    assert other.given
    assert ground.joined.ground.law == 1


def test_messages_carry_the_pose_of_now_where_no_frames_reach_the_vehicle() -> None:
    ground = Ground(ground_config(CONFIG, onboard_mocap=False))
    ground.speed_mps = 1.0
    for _ in range(60):
        ground.cycle()
    pose = ground.joined.ground.pose
    assert pose is not None
    assert pose.position_w_m[0] == pytest.approx(ground.place[0] + 0.01, abs=1e-3), "carried forward over 10 ms"
    for _ in range(8):
        ground.cycle(sees=False)
    assert ground.joined.ground.pose is None, "an old pose is none"
    assert Ground().cycle().link.session is not None


def test_a_pose_that_jumps_ends_a_flight_that_nobody_else_sees() -> None:
    blind, seeing = Ground(ground_config(CONFIG, onboard_mocap=False)), Ground()
    for ground in (blind, seeing):
        ground.lift_off()
        for _ in range(20):
            ground.plan()
            ground.cycle()
        ground.place = ground.place + np.array([0.8, 0.0, 0.0])
        for _ in range(20):
            ground.plan()
            tick = ground.cycle()
    assert not tick.failure, "the vehicle's own checks see it"
    assert blind.law.failure == "motion capture's pose jumped in flight, or came back elsewhere after a gap"
    assert blind.joined.ground.pose is None
    blind.report(airborne=False, phase=PHASES.index(Phase.DISARMED))
    blind.cycle()
    assert not blind.law.failure
    assert math.isfinite(blind.law.made_for_s)


def test_neither_a_resume_nor_another_law_makes_a_pose_that_jumped_trusted() -> None:
    blind = Ground(ground_config(CONFIG, onboard_mocap=False))
    blind.lift_off()
    blind.cycle()
    blind.place = blind.place + np.array([2.0, 0.0, 0.0])
    for _ in range(20):
        blind.cycle()
    assert "jumped" in blind.law.failure
    blind.law.switch("other", Scripted())
    blind.plan()
    blind.report(epoch=2)
    tick = blind.cycle()
    assert tick.flags & UpFlags.FAILED
    assert blind.joined.ground.pose is None
    blind.report(epoch=2, airborne=False, phase=PHASES.index(Phase.DISARMED))
    blind.cycle()
    assert blind.law.failure == ""
