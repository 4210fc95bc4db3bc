"""Several vehicles in one room: their worlds in lockstep, with downwash and collisions between them.

Deterministic as one world is: the same configuration, seed and timed inputs give the same truths, bit by bit.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mock_autopilot.config import MockConfig
from mock_autopilot.fleet.config import body_names, vehicle_config
from mock_autopilot.physics import quaternion_one as quat_one
from mock_autopilot.physics.downwash import WashedVehicle, mean_push_n, mean_torque_nm
from mock_autopilot.physics.truth import Truth
from mock_autopilot.world import STEP_S, World

AIR_EVERY = 5
"""Steps between two looks at the air and the bodies: 10 ms."""
_WASH_KEY = 2_000_000


@dataclass(frozen=True)
class Collision:
    """Two bodies that have met."""

    time_s: float
    bodies: tuple[str, str]

    def __str__(self) -> str:
        """Return the two names."""
        return " and ".join(self.bodies)


class Fleet:
    """The worlds of all vehicles; `advance` is the only way time passes in them."""

    def __init__(self, config: MockConfig, seed: int = 1, step_s: float = STEP_S) -> None:
        self._config = config.fleet
        self.names = body_names(config)
        """Names of the vehicles' rigid bodies."""
        numbers = range(1, config.fleet.vehicles + 1)
        self.worlds = [World(vehicle_config(config, n), vehicle_seed(seed, n), step_s) for n in numbers]
        self._step_s, self._steps = step_s, 0
        self._washed = [
            WashedVehicle(
                np.random.default_rng(np.random.SeedSequence(vehicle_seed(seed, n), spawn_key=(_WASH_KEY,))),
                config.arms.inertia_kgm2,
                world.vehicle.params.trim_times_s,
                AIR_EVERY * step_s,
            )
            for n, world in zip(numbers, self.worlds, strict=True)
        ]
        self.collisions: list[Collision] = []
        """All that have happened."""
        self.collision_observers: list[Callable[[Collision], None]] = []
        self.observers: list[Callable[[tuple[Truth, ...]], None]] = []
        """Callbacks for the truths of every step, in the vehicles' order."""

    @property
    def time_s(self) -> float:
        """Return the simulated time since the start."""
        return self._steps * self._step_s

    def advance(self, to_s: float) -> None:
        """Let time pass step by step, in all worlds together, as far as whole steps reach."""
        while (self._steps + 1) * self._step_s <= to_s + 1e-9:
            if self._steps % AIR_EVERY == 0:
                self._meet()
            self._steps += 1
            for world in self.worlds:
                world.advance(self.time_s)
            truths = tuple(world.truth for world in self.worlds)
            for observer in self.observers:
                observer(truths)

    def _meet(self) -> None:
        """Let the vehicles act on each other for the next steps."""
        places = [world.position_ned_m for world in self.worlds]
        if self._config.collisions:
            for first, second in combinations(range(len(places)), 2):
                self._collide(first, second, places)
        if self._config.downwash:
            for number in range(len(places)):
                self._wash(number, places)

    def _collide(self, first: int, second: int, places: list[tuple[float, float, float]]) -> None:
        (x1, y1, z1), (x2, y2, z2) = places[first], places[second]
        apart_m = math.hypot(x1 - x2, y1 - y2)
        if apart_m >= 2.0 * self._config.body_radius_m or abs(z1 - z2) >= self._config.body_height_m:
            return
        bodies = self.names[first], self.names[second]
        if any(known.bodies == bodies for known in self.collisions):
            return
        collision = Collision(self.time_s, bodies)
        self.collisions.append(collision)
        for world, other in ((self.worlds[first], bodies[1]), (self.worlds[second], bodies[0])):
            world.crash(f"Collision with {other}")
        for observer in self.collision_observers:
            observer(collision)

    def _wash(self, number: int, places: list[tuple[float, float, float]]) -> None:
        """Set the push on one vehicle by the jets of those above it."""
        x, y, z = places[number]
        push_n, about_north_nm, about_east_nm = 0.0, 0.0, 0.0
        for upper, (ux, uy, uz) in zip(self.worlds, places, strict=True):
            if uz < z and upper.thrust_n > 0.0:
                towards = ux - x, uy - y
                one_n = mean_push_n(upper.thrust_n, z - uz, math.hypot(*towards))
                north_nm, east_nm = mean_torque_nm(one_n, z - uz, towards)
                push_n, about_north_nm, about_east_nm = (
                    push_n + one_n,
                    about_north_nm + north_nm,
                    about_east_nm + east_nm,
                )
        world = self.worlds[number]
        yaw_rad = quat_one.yaw_of(world.q_ned_frd_wxyz)
        world.air_push = self._washed[number].step(push_n, (about_north_nm, about_east_nm), yaw_rad)


def vehicle_seed(seed: int, number: int) -> int:
    """Return the seed of a vehicle of a fleet: the first one's is the fleet's own."""
    return seed if number == 1 else int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
