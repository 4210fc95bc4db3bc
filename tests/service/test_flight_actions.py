"""The operator's verbs, on a whole vehicle in simulated time; the verbs' own waits are real."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.config.px4_config import Px4Config
from companion.core.interfaces import AutopilotError, ConfigError, FlightError
from companion.core.types import AutopilotStatus
from companion.flight.assembly import Devices, stages_of
from companion.flight.flight_loop import FlightLoop
from companion.preflight.checks.check import Check
from companion.protocol.check import Tell
from companion.service.flight_actions import DeviceReports, FlightActions, Preflight
from companion.service.trajectory_space import check_room_and_fence
from companion.supervisor.flight_state import (
    ArmRequest,
    HoldRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    ResumeRequest,
)
from companion.trajectories.reference import Ellipse, LapTiming
from tests.flights.simulated import Room, SimulatedMocap
from tests.flights.simulated_autopilot import SimulatedAutopilot
from tests.flights.simulated_servos import SimulatedServos
from tests.flights.test_simulated_arms import ARMS, mock_arms, no_params
from tests.watchdog_timer import NoWatchdogTimer

NOT_FLYING = "the vehicle is on the ground, and this service does not fly it"
BOOTED_S = 1.5
"""By then the mock's PX4 trusts its pose; its checks after the boot, which take 4 s and more, are ended in `served`."""


class Insisting(SimulatedAutopilot):
    """Asks to arm again and again, as the real adapter does."""

    def __init__(self, room: Room) -> None:
        super().__init__(room.bench)
        self.asked = 0
        self.deaf_to_arm = False
        """The commands are lost."""

    async def arm(self) -> None:
        while not self.status().armed:
            self.asked += 1
            if not self.deaf_to_arm:
                self.command(400, 1.0)
            await self._pass_time(0.5)


class Paced(SimulatedMocap):
    """Lets simulated time pass no faster than real: a verb's wait of a second is no minute of flight then."""

    def why_silent(self) -> str:
        return ""

    async def wait_frame(self, timeout_s: float) -> bool:
        await asyncio.sleep(0.01)
        return await super().wait_frame(timeout_s)


@dataclass
class Served:
    """A service, and what it is in charge of."""

    service: FlightActions
    room: Room
    autopilot: Insisting
    cycles: int = 0

    def phase(self) -> Phase:
        return self.service.phase

    async def until(self, time_s: float) -> None:
        while self.room.now_s() < time_s:  # noqa: ASYNC110 - simulated time, no event tells of it
            await asyncio.sleep(0)


@asynccontextmanager
async def served(
    room: Room,
    config: CompanionConfig | None = None,
    in_preflight: Callable[[FlightLoop], object] = lambda _: None,
    cameras: type[SimulatedMocap] = SimulatedMocap,
    preflight: Preflight | None = None,
) -> AsyncIterator[Served]:
    config, autopilot = config or CompanionConfig(), Insisting(room)
    room.bench.world.vehicle.commander._checks_pass_s = 0.0
    servos = SimulatedServos(room) if config.arms is not None else None
    law = load_controller("etnn", config.vehicle_model(), 0.01).law

    def count() -> None:
        one.cycles += 1

    async def passed(_: Tell) -> Sequence[Check]:
        in_preflight(loop)
        return ()

    devices = Devices(
        mocap=cameras(room, count), autopilot=autopilot, clock=room, watchdog_timer=NoWatchdogTimer(), arms=servos
    )
    loop = FlightLoop(devices, stages_of(devices, law, config), lambda _: None, "etnn")
    ticking = asyncio.create_task(loop.run())
    reports = DeviceReports(preflight or passed, no_params)
    one = Served(FlightActions(loop, autopilot, config, ticking, reports), room, autopilot)
    try:
        yield one
    finally:
        ticking.cancel()
        while not ticking.done():  # what it still asks of the autopilot takes simulated time
            room.new_frame = False
            room.pass_time(0.01)
            await asyncio.sleep(0)


@pytest.mark.parametrize(
    ("order", "why"),
    [(KillRequest(), "the operator stopped the motors"), (LandRequest("the operator aborted"), "the operator aborted")],
    ids=["kill", "abort"],
)
async def test_an_order_to_stop_ends_the_asking_to_arm(order: Request, why: str) -> None:
    async with served(Room(1)) as one:
        await one.until(BOOTED_S)
        one.autopilot.deaf_to_arm = True
        arming = asyncio.create_task(one.service.arm())
        while not one.autopilot.asked:  # noqa: ASYNC110
            await asyncio.sleep(0)
        assert not one.service.loop.submit(order)
        with pytest.raises(FlightError, match=why):
            await asyncio.wait_for(arming, 30.0)
        one.autopilot.deaf_to_arm, asked = False, one.autopilot.asked
        await one.until(one.room.now_s() + 10.0)
        assert one.autopilot.asked == asked
        assert not one.autopilot.status().armed


async def test_a_kill_while_the_checks_run_ends_the_arming() -> None:
    async with served(Room(1), in_preflight=lambda loop: loop.submit(KillRequest())) as one:
        await one.until(BOOTED_S)
        with pytest.raises(FlightError, match=r"^the operator stopped the motors$"):
            await one.service.arm()
        assert one.phase() is Phase.TERMINATED
        assert one.autopilot.asked == 0


@pytest.mark.parametrize(
    ("order", "why"),
    [
        (LandRequest("the operator aborted"), "the operator aborted"),
        (LandRequest(), "a landing was ordered"),
        (None, "a landing was"),
    ],
)
async def test_an_abort_while_the_checks_run_ends_them(order: LandRequest | None, why: str) -> None:
    running, ended = asyncio.Event(), asyncio.Event()

    async def preflight(_: Tell) -> Sequence[Check]:
        running.set()
        try:
            await asyncio.sleep(60.0)
        finally:
            ended.set()
        return ()

    async with served(Room(1), preflight=preflight) as one:
        await one.until(BOOTED_S)
        assert one.service.loop.refusal(LandRequest()) == NOT_FLYING
        arming = asyncio.create_task(one.service.arm())
        await running.wait()
        with pytest.raises(FlightError, match=r"^the checks before arming run already; wait until they end$"):
            await one.service.arm()
        if order is None:
            await one.service.land()
        else:
            assert not one.service.loop.submit(order)
        with pytest.raises(FlightError, match=f"^{why}"):
            await asyncio.wait_for(arming, 30.0)
        assert ended.is_set()
        assert one.phase() is Phase.STANDBY
        assert one.service.loop.refusal(LandRequest()) == NOT_FLYING
        assert one.autopilot.asked == 0


async def test_an_abort_that_comes_with_the_last_check_prevents_the_arming_all_the_same() -> None:
    async with served(Room(1), in_preflight=lambda loop: loop.submit(LandRequest("the operator aborted"))) as one:
        await one.until(BOOTED_S)
        with pytest.raises(FlightError, match=r"^the operator aborted$"):
            await one.service.arm()
        assert (one.phase(), one.autopilot.asked) == (Phase.STANDBY, 0)


async def test_a_hold_ordered_in_the_climb_is_no_takeoff_to_the_height() -> None:
    async with served(Room(1)) as one:
        await one.until(BOOTED_S)
        await one.service.arm()
        climbing = asyncio.create_task(one.service.take_off(1.2))
        while not one.service.loop.flight.airborne:
            assert one.service.loop.submit(HoldRequest())
            await asyncio.sleep(0)
        assert not one.service.loop.submit(HoldRequest())
        with pytest.raises(
            FlightError, match=r"^ended by another command: a hold was ordered, .* at 0\.\d\d m, not at 1\.2 m$"
        ):
            await asyncio.wait_for(climbing, 30.0)
        assert one.phase() is Phase.HOLD
        await one.until(one.room.now_s() + 3.0)
        assert 0.0 < one.room.truth_w_m[2] < 0.4, "it stays where it was held"


class Mute(Insisting):
    """Says everything but whether it stands or flies."""

    def status(self) -> AutopilotStatus:
        return replace(super().status(), in_air=None)


async def test_who_does_not_say_that_he_stands_is_not_taken_for_one_that_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.service.test_flight_actions.Insisting", Mute)
    unknown = "the autopilot does not say whether the vehicle stands or flies"
    config = CompanionConfig(px4=Px4Config(answer_timeout_s=0.1))
    async with served(Room(1), config) as one:
        await one.until(BOOTED_S)
        with pytest.raises(AutopilotError, match="heard once but does not say whether the vehicle stands or flies"):
            await one.service.arm()
        assert one.service.loop.refusal(ArmRequest()) == unknown
        assert one.service.loop.refusal(ResumeRequest()) == unknown


async def test_what_leads_out_is_refused_in_flight_and_what_was_flown_goes_on() -> None:
    far, near = (Ellipse(np.array([x_m, 0.0, 1.0]), timing=LapTiming(5.0, 2)) for x_m in (3.2, 3.0))
    async with served(Room(1)) as one:
        service = one.service
        await one.until(BOOTED_S)
        await service.arm()
        for height_m, why in (
            (3.3, r"hovers 0\.\d\d m inside, at least 0\.3 wanted"),
            (math.inf, "hovers nan m inside"),
            (math.nan, "nan m is too low to hover at, at least 0.3 m"),
            (-1.0, "-1 m is too low to hover at, at least 0.3 m"),
        ):
            with pytest.raises(FlightError, match=why):
                await service.take_off(height_m)
            assert one.phase() is Phase.ARMED
        await service.take_off(0.5)
        flown = service.loop.flight.legs
        with pytest.raises(ConfigError, match=r"^the trajectory: leaves the room: x = 4\.\d\d m at .* \(room\.x_m\)$"):
            await service.fly(far)
        with pytest.raises(
            FlightError, match=r"^fence around the trajectory: .*braking would end 0\.2\d m inside, at least 0\.3"
        ):
            await service.fly(near)
        assert one.phase() is Phase.HOLD
        assert service.loop.flight.legs is flown
        cycles = one.cycles
        await check_room_and_fence(Ellipse(np.array([0.0, 0.0, 1.0])), CompanionConfig().room, CompanionConfig().fence)
        assert one.cycles > cycles + 20, "the loop goes on while 34 s of trajectory are looked at"


async def test_arms_are_left_alone_when_a_service_starts_while_the_vehicle_flies() -> None:
    config = CompanionConfig(arms=ARMS)
    room = Room(1, arms=mock_arms())
    async with served(room, config) as first:
        await first.until(BOOTED_S)
        await first.service.arms.prepare()
        await first.service.arm()
        await first.service.take_off(0.5)
        room.inject("autopilot wrong (pilot takes over)")
        while first.phase() is not Phase.HANDED_OVER:  # noqa: ASYNC110
            await asyncio.sleep(0)
    async with served(room, config, cameras=Paced) as anew:
        with pytest.raises(FlightError, match="the vehicle is already in the air"):
            await anew.service.arms.prepare()


async def test_a_hold_ordered_on_the_way_or_in_the_trajectory_is_no_flown_trajectory() -> None:
    lap = Ellipse(np.array([0.0, 0.0, 1.0]), timing=LapTiming(12.0, 1))
    async with served(Room(1)) as one:
        await one.until(BOOTED_S)
        await one.service.arm()
        await one.service.take_off(0.5)
        for begun in (Phase.HOLD, Phase.TRACK):
            flying = asyncio.create_task(one.service.fly(lap))
            legs = one.service.loop.flight.legs
            while one.service.loop.flight.legs is legs or one.phase() is not begun:  # noqa: ASYNC110
                await asyncio.sleep(0)
            assert not one.service.loop.submit(HoldRequest())
            with pytest.raises(
                FlightError, match=r"^ended by another command: a hold was ordered, the vehicle hovers$"
            ):
                await asyncio.wait_for(flying, 30.0)
            assert one.phase() is Phase.HOLD


async def test_who_waits_for_a_pilots_landing_commands_nothing() -> None:
    async with served(Room(1)) as one:
        await one.until(BOOTED_S)
        await one.service.arm()
        await one.service.take_off(0.5)
        one.room.inject("autopilot wrong (pilot takes over)")
        while one.phase() is not Phase.HANDED_OVER:  # noqa: ASYNC110
            await asyncio.sleep(0)
        waiting = asyncio.create_task(one.service.land())
        await one.until(one.room.now_s() + 3.0)
        assert one.autopilot.land_calls == 0
        assert one.autopilot.status().armed
        waiting.cancel()
        await asyncio.wait([waiting])
