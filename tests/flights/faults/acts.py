"""Faults that the mock has no word for: acts of the operator, the computer, the law and the wind."""

import math
from dataclasses import replace

import numpy as np

from companion.control.controller import ControlInput, ControlOutput
from companion.control.gains import PidGains
from companion.control.pid import Pid, PidMemory
from companion.core.types import AutopilotStatus, OtherService
from companion.flight.health_step import Sides
from companion.geometry.frames import flip_yz
from companion.supervisor.flight_state import KillRequest, LandRequest, TakeoffRequest
from mock_autopilot.faults.catalogue import Part
from mock_autopilot.physics.plant import Wrench, no_wrench
from mock_autopilot.physics.truth import Truth
from mock_autopilot.servos.config import Fault, FaultKind
from tests.flights.faults.rows import Act
from tests.flights.simulated import Flight

ANOTHER_BODY_S = 0.5


def abort(flight: Flight) -> None:
    """The operator's, Ctrl-C or land."""
    flight.loop.submit(LandRequest())


def kill(flight: Flight) -> None:
    """The operator's, confirmed."""
    flight.loop.submit(KillRequest())


def gust(force_w_n: tuple[float, float, float], for_s: float = math.inf) -> Act:
    """A push, W."""

    def blow(flight: Flight) -> None:
        world = flight.room.bench.world
        end_s, push = world.time_s + for_s, Wrench(flip_yz(np.array(force_w_n)), np.zeros(3))

        def go_on(truth: Truth) -> None:
            world.external_wrench = push if truth.time_s < end_s else no_wrench()

        world.observers.append(go_on)

    return blow


def take_off_by_another_body(flight: Flight) -> None:
    """Motion capture has looked at a body in the corner for half a second when the operator says takeoff."""
    flight.room.inject("mocap wrong (swapped)")
    waiting, due_s = [TakeoffRequest(1.2)], flight.room.now_s() + ANOTHER_BODY_S

    def go_on(truth: Truth) -> None:
        if waiting and truth.time_s >= due_s:
            flight.loop.submit(waiting.pop())

    flight.room.bench.world.observers.append(go_on)


def safety_line(bobbing_n: float) -> Act:
    """Return an act that holds the vehicle on its line 0.7 m above the floor, where it bobs; free after 19 s.

    By 0.04 m/s for each newton. PX4's land detector takes 0.25 m/s for standing, in its later stages 0.62 m/s
    (LNDMC_Z_VEL_MAX): 16 N are too fast for it; with 8 N the vehicle has landed, and its motors stop.
    """

    def hang(flight: Flight) -> None:
        world = flight.room.bench.world
        free_s = world.time_s + 19.0

        def pull(truth: Truth) -> None:
            up_m, up_mps = -truth.position_ned_m[2], -truth.velocity_ned_mps[2]
            pull_n = 250.0 * (0.7 - up_m) - 20.0 * up_mps + bobbing_n * math.sin(6.0 * truth.time_s)
            taut = up_m < 0.7 and truth.time_s < free_s
            force = np.array([0.0, 0.0, -max(0.0, pull_n)]) if taut else np.zeros(3)
            world.external_wrench = Wrench(force, np.zeros(3))

        world.observers.append(pull)

    return hang


def one_servo(kind: FaultKind, servo_id: int, **more: float) -> Act:
    """Return an act that injects a fault of one servo, which the mock's words do not cover."""

    def break_it(flight: Flight) -> None:
        servos = flight.room.bench.world.servos
        assert servos is not None
        servos.inject(Fault.model_validate({"kind": kind, "id": servo_id} | more))

    return break_it


class Raises(Pid):
    """A law with a mistake."""

    def step(self, memory: PidMemory, now: ControlInput) -> tuple[PidMemory, ControlOutput]:  # noqa: ARG002
        raise ZeroDivisionError("a mistake in somebody's law")


class GivesNan(Pid):
    """A law that divides by zero."""

    def step(self, memory: PidMemory, now: ControlInput) -> tuple[PidMemory, ControlOutput]:
        after, output = super().step(memory, now)
        return after, replace(output, accel_w_mps2=output.accel_w_mps2 * np.nan)


def law_raises(flight: Flight) -> None:
    """Make the law raise from now on; flown with "pid"."""
    flight.loop._pipeline._controller = Raises(PidGains())


def law_gives_nan(flight: Flight) -> None:
    """Make the law give NaN from now on; flown with "pid"."""
    flight.loop._pipeline._controller = GivesNan(PidGains())


def disk_full(flight: Flight) -> None:
    """100 MB are left where records go."""
    flight.loop._health._sides = Sides(disk_free_mb=lambda: 100.0)


def reflections(flight: Flight) -> None:
    """Motion capture sees a bright spot somewhere in the room instead of the vehicle, elsewhere in every frame."""
    rng, room = np.random.default_rng(1), flight.room

    def look(_: Truth) -> None:
        room.offset_w_m = rng.uniform(-2.0, 2.0, 3)

    room.bench.world.observers.append(look)


def bad_battery_sample(flight: Flight) -> None:
    """For 0.2 s the autopilot says that the battery is empty."""
    autopilot, end_s = flight.autopilot, flight.room.now_s() + 0.2
    status = autopilot.status

    def said() -> AutopilotStatus:
        now = status()
        return replace(now, battery_fraction=0.02) if flight.room.now_s() < end_s else now

    autopilot.status = said  # type: ignore[method-assign]


def told_by_another(command: int, *params: float) -> Act:
    """Somebody else's ground station commands the autopilot."""
    return lambda flight: flight.autopilot.command(command, *params)


class _Broker:
    """interfaces.OperatorLink to a broker that is there but for the mock's `broker off`."""

    def __init__(self, flight: Flight) -> None:
        self._faults, self._now_s = flight.room.bench.world.faults, flight.room.now_s

    def age_s(self) -> float:
        gone = self._faults.active(Part.BROKER)
        return self._now_s() - min(held.since_s for held in gone) if gone else 0.0

    def others(self) -> tuple[OtherService, ...]:
        return ()


def connect_broker(flight: Flight) -> None:
    """The companion has one from now on."""
    flight.loop._health._sides = Sides(operator=_Broker(flight))


def broker_gone(flight: Flight) -> None:
    """Connect a broker, and lose it from now on."""
    connect_broker(flight)
    flight.room.inject("broker off")


def busy(for_s: float, cycles: int) -> Act:
    """So many control cycles take so much longer."""

    def load(flight: Flight) -> None:
        tick, left = flight.loop.tick, [cycles]

        def slow(now_s: float, late_s: float) -> None:
            tick(now_s, late_s)
            if left[0] > 0:
                left[0] -= 1
                flight.room.bench.run(for_s)

        flight.loop.tick = slow  # type: ignore[method-assign]

    return load
