"""The cylinder around other vehicles: how near, where two come to rest, and how hard one may be driven at another."""

import math
import random
from dataclasses import dataclass, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.types import OtherVehicle, Vec3
from companion.guard.separation import NO_WALLS, Separation, Wall, Walls

CYLINDER = Separation(radius_m=1.2, height_m=1.6, parked_height_m=1.0, braking_mps2=2.0, reaction_s=0.4)
STILL = (0.0, 0.0, 0.0)
NAN = (math.nan, math.nan, math.nan)


def other(place: Vec3, velocity: Vec3 = STILL, parked: bool = False) -> OtherVehicle:
    return OtherVehicle(body="two", position_w_m=place, velocity_w_mps=velocity, parked=parked)


def one_wall(place: Vec3, own_velocity: Vec3 = STILL, velocity: Vec3 = STILL, acting: Vec3 = STILL) -> Wall:
    """The wall that another vehicle makes for one at the origin, beside it."""
    walls = CYLINDER.walls(STILL, own_velocity, acting, [other(place, velocity)])
    assert (walls.least_up_mps2, walls.most_up_mps2) == (-math.inf, math.inf)
    (wall,) = walls.sideways
    return wall


def up_range(
    place: Vec3, own_velocity: Vec3 = STILL, velocity: Vec3 = STILL, acting: Vec3 = STILL
) -> tuple[float, float]:
    """The vertical range that another vehicle leaves one at the origin, above or below it."""
    walls = CYLINDER.walls(STILL, own_velocity, acting, [other(place, velocity)])
    assert walls.sideways == ()
    return walls.least_up_mps2, walls.most_up_mps2


@pytest.mark.parametrize(
    ("place", "parked", "gap_m"),
    [
        ((2.2, 0.0, 0.0), False, 1.0),
        ((0.0, -2.2, 0.0), False, 1.0),
        ((0.72, 0.96, 1.5), False, 0.0),  # 3-4-5: 1.2 m away
        ((0.6, 0.8, 0.0), False, -0.2),
        ((0.0, 0.0, 1.7), False, 0.1),
        ((0.0, 0.0, -1.7), False, 0.1),
        ((0.0, 0.0, -1.5), False, -0.1),
        ((0.0, 0.0, -1.5), True, 0.5),
        ((0.0, 0.0, -0.9), True, -0.1),
        ((1.1, 0.0, 1.55), False, -0.05),
        ((3.2, 0.0, 2.0), False, 2.0),
    ],
)
def test_the_gap_is_the_larger_of_beside_and_above(place: Vec3, parked: bool, gap_m: float) -> None:
    assert CYLINDER.gap_m(STILL, other(place, parked=parked)) == pytest.approx(gap_m)
    assert CYLINDER.gap_between_m(place, STILL, parked) == pytest.approx(gap_m)


def test_a_wider_cylinder_is_wider_on_every_side() -> None:
    assert CYLINDER.lowered == replace(CYLINDER, height_m=1.0)
    assert CYLINDER.widened(0.25) == replace(CYLINDER, radius_m=1.45, height_m=1.85, parked_height_m=1.25)


@pytest.mark.parametrize(
    ("speed_mps", "stop_m"), [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.65), (1.5, 1.1625), (2.0, 1.8), (math.nan, 0.0)]
)
def test_a_vehicle_stops_after_its_reaction_and_its_brake(speed_mps: float, stop_m: float) -> None:
    assert CYLINDER.stop_m(speed_mps) == pytest.approx(stop_m)


# --- walls ---


@pytest.mark.parametrize(
    ("distance_m", "own_mps", "theirs_mps", "most_mps2"),
    [
        (1.2, 0.0, 0.0, 0.0),  # at the cylinder, at rest: nothing further
        (1.65, 1.0, 0.0, 0.0),  # 0.45 m left: what 1 m/s needs after half the reaction, 0.2 + 0.25
        (2.30, 1.0, -1.0, 0.0),  # the other needs 0.65 m of its own
        (1.65, 1.0, 1.0, 0.0),  # one that flies ahead may stop at once: no credit
        (9.2, 0.0, 0.0, 8.48105),  # 8 = 0.3 u + u^2 / 4 after 0.6 s: the autopilot may hear nothing else for so long
    ],
)
def test_the_way_left_is_shared_by_what_each_needs_to_stop(
    distance_m: float, own_mps: float, theirs_mps: float, most_mps2: float
) -> None:
    left_m = distance_m + 0.2 * own_mps  # half the reaction is flown before the acceleration acts
    for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.6, -0.8)):
        wall = one_wall(
            (left_m * x, left_m * y, 0.0), (own_mps * x, own_mps * y, 0.0), (theirs_mps * x, theirs_mps * y, 0.0)
        )
        assert (wall.x, wall.y) == pytest.approx((x, y))
        assert wall.most_mps2 == pytest.approx(most_mps2, abs=1e-4)


@given(
    left_m=st.floats(0.0, 3.0),
    own_mps=st.floats(-1.5, 1.5),
    theirs_mps=st.floats(-1.5, 0.0),
    acting=st.floats(-3.0, 3.0),
)
def test_a_vehicle_that_is_left_alone_with_what_the_wall_lets_it_do_can_still_stop(
    left_m: float, own_mps: float, theirs_mps: float, acting: float
) -> None:
    wall = one_wall((1.2 + left_m, 0.0, 0.0), (own_mps, 0.0, 0.0), (theirs_mps, 0.0, 0.0), (acting, 0.0, 0.0))
    speed_mps = own_mps + 0.2 * acting
    flown_m = 0.2 * own_mps + 0.02 * acting + 0.6 * speed_mps + 0.18 * wall.most_mps2
    end_mps = max(speed_mps + 0.6 * wall.most_mps2, 0.0)
    if wall.most_mps2 > 0.0:
        assert flown_m + end_mps**2 / 4.0 + CYLINDER.stop_m(-theirs_mps) <= left_m + 1e-9


def test_the_acceleration_that_acts_is_counted_for_half_the_reaction() -> None:
    acted = one_wall((2.0, 0.0, 0.0), (0.5, 0.0, 0.0), acting=(1.0, 0.0, 0.0))
    after = one_wall((2.0 - 0.5 * 0.2 - 0.02, 0.0, 0.0), (0.7, 0.0, 0.0))
    shift_m = 0.7 * 0.2  # the second one flies half a reaction more at its speed
    again = one_wall((2.0 - 0.5 * 0.2 - 0.02 + shift_m, 0.0, 0.0), (0.7, 0.0, 0.0))
    assert acted.most_mps2 == pytest.approx(again.most_mps2)
    assert after.most_mps2 < acted.most_mps2


def test_one_that_comes_too_near_is_backed_away_from_and_the_more_the_nearer() -> None:
    demands = [one_wall((distance_m, 0.0, 0.0)).most_mps2 for distance_m in (1.19, 1.1, 0.9)]
    assert demands == sorted(demands, reverse=True)
    assert demands[0] < 0.0


def test_deep_inside_it_backs_away_no_faster_than_it_can_stop_again() -> None:
    assert one_wall((0.9, 0.0, 0.0)).most_mps2 == pytest.approx(one_wall((0.2, 0.0, 0.0)).most_mps2)
    assert up_range((0.0, 0.0, 1.3)) == pytest.approx(up_range((0.0, 0.0, 0.5)))
    comes, stands = one_wall((0.5, 0.0, 0.0), velocity=(-1.0, 0.0, 0.0)), one_wall((0.5, 0.0, 0.0))
    assert comes.most_mps2 < stands.most_mps2, "from one that comes on it backs away faster"


@pytest.mark.parametrize(
    ("place", "own", "theirs", "allowed"),
    [
        ((0.0, 0.0, 1.6), STILL, STILL, (-math.inf, 0.0)),
        ((0.3, 0.0, -1.6), STILL, STILL, (0.0, math.inf)),
        ((0.0, 0.3, 2.25), (0.0, 0.0, 1.0), STILL, (-math.inf, 0.0)),
        ((0.3, 0.0, -2.9), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, math.inf)),
        ((0.0, 0.0, 2.9), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (-math.inf, 0.0)),
    ],
)
def test_above_and_below_the_vertical_motion_is_limited(
    place: Vec3, own: Vec3, theirs: Vec3, allowed: tuple[float, float]
) -> None:
    assert up_range(place, own, theirs) == pytest.approx(allowed, abs=1e-9)


def test_the_direction_with_more_room_keeps_two_apart_and_both_see_the_same() -> None:
    """0.3 m are left beside it and 0.2 m above: sideways; with 0.1 m more above, vertically."""
    assert one_wall((1.5, 0.0, 1.8)).most_mps2 > 0.0
    assert up_range((1.5, 0.0, 1.95))[1] > 0.0
    assert one_wall((1.5, 0.0, 1.95), (0.0, 0.0, 0.3)).x == 1.0, "it climbs: the room above is not there any more"
    mirrored = CYLINDER.walls((1.5, 0.0, 1.95), STILL, STILL, [other(STILL, (0.0, 0.0, 0.3))])
    assert mirrored.sideways[0].x == -1.0


def test_exactly_above_one_another_no_side_is_better() -> None:
    assert up_range((0.0, 0.0, 1.0))[1] < 0.0
    assert up_range((0.0, 0.0, -1.0))[0] > 0.0


def test_above_a_parked_one_there_is_less_to_keep() -> None:
    low = CYLINDER.walls(STILL, STILL, STILL, [other((0.0, 0.0, -1.2), parked=True)])
    assert low.least_up_mps2 < 0.0
    assert CYLINDER.walls(STILL, STILL, STILL, [other((0.0, 0.0, -1.2))]).least_up_mps2 > 0.0


@pytest.mark.parametrize(
    ("unseen_s", "parked", "distance_m"),
    [(0.2, False, 1.2), (2.0, False, 1.9625), (4.0, False, 3.85), (60.0, False, 4.2), (60.0, True, 1.2)],
)
def test_from_one_that_is_not_seen_it_keeps_a_distance_that_grows_unless_it_stood(
    unseen_s: float, parked: bool, distance_m: float
) -> None:
    def wall_at(place: Vec3) -> Walls:
        return CYLINDER.walls(STILL, STILL, STILL, [replace(other(place, parked=parked), unseen_s=unseen_s)])

    assert wall_at((distance_m + 0.02, 0.0, 0.0)).sideways[0].most_mps2 > 0.0
    assert wall_at((distance_m - 0.02, 0.0, 0.0)).sideways[0].most_mps2 < 0.0


def test_below_and_above_one_that_is_not_seen_it_goes_aside_as_it_comes_down_somewhere() -> None:
    for height_m in (-2.5, 2.5):
        hidden = replace(other((0.5, 0.0, height_m)), unseen_s=2.0)
        (wall,) = CYLINDER.walls(STILL, STILL, STILL, [hidden]).sideways
        assert (wall.x, wall.most_mps2 < 0.0) == (1.0, True)


@pytest.mark.parametrize("unknown", [other(NAN), other((1.0, 0.0, 0.0), NAN), other((math.inf, 0.0, 0.0))])
def test_one_that_was_never_seen_makes_no_wall(unknown: OtherVehicle) -> None:
    assert CYLINDER.walls(STILL, STILL, STILL, [unknown]) == NO_WALLS


def test_two_others_leave_what_both_leave() -> None:
    above_and_below = [other((0.0, 0.0, 1.6)), other((0.1, 0.0, -1.6)), other((2.0, 0.0, 0.0)), other((0.0, 2.0, 0.0))]
    walls = CYLINDER.walls(STILL, STILL, STILL, above_and_below)
    assert (walls.least_up_mps2, walls.most_up_mps2) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert [(wall.x, wall.y) for wall in walls.sideways] == [(1.0, 0.0), (0.0, 1.0)]


# --- accelerations behind walls ---

EAST, NORTH = Wall(1.0, 0.0, -1.0), Wall(0.0, 1.0, 0.5)


def test_a_wall_lets_what_is_behind_it() -> None:
    walls = Walls((EAST, NORTH), -2.0, 1.0)
    assert walls.let((-1.0, 0.5, 0.0))
    assert walls.let((-1.0, 0.5, -2.0))
    for beyond in ((-0.9, 0.0, 0.0), (-2.0, 0.6, 0.0), (-2.0, 0.0, 1.1), (-2.0, 0.0, -2.1)):
        assert not walls.let(beyond)
    assert NO_WALLS.let((9.0, 9.0, 9.0))


def test_what_is_beyond_is_brought_back_the_shortest_way() -> None:
    walls = Walls((EAST, NORTH))
    assert walls.behind(-3.0, 0.2, 9.0) == (-3.0, 0.2)
    assert walls.behind(2.0, 0.2, 9.0) == (-1.0, 0.2)
    assert walls.behind(2.0, 3.0, 9.0) == (-1.0, 0.5)


def test_no_wall_asks_for_more_than_the_vehicle_can() -> None:
    assert Walls((Wall(1.0, 0.0, -50.0),)).behind(0.0, 1.0, 3.5) == (-3.5, 1.0)


def test_two_walls_at_an_angle_are_both_kept() -> None:
    """Others ahead to the left and to the right: each correction pushes towards the other wall a little."""
    left, right = Wall(0.8, 0.6, -1.0), Wall(0.8, -0.6, -1.0)
    x, y = Walls((left, right)).behind(2.0, 0.3, 9.0)
    assert left.beyond_mps2(x, y) <= 0.01
    assert right.beyond_mps2(x, y) <= 0.01


def test_with_little_tilt_left_braking_goes_before_turning() -> None:
    walls = Walls((NORTH, EAST))
    assert walls.tangent_first(-2.0, 2.0, 3.0) == (-2.0, 2.0), "enough for both"
    assert walls.tangent_first(-2.0, 4.0, 2.5) == pytest.approx((-2.0, 1.5))
    assert walls.tangent_first(-2.0, -4.0, 2.5) == pytest.approx((-2.0, -1.5))
    assert walls.tangent_first(-5.0, 1.0, 2.5) == pytest.approx((-2.5, 0.0))
    assert walls.tangent_first(5.0, 1.0, 2.5) == pytest.approx((2.5, 0.0))
    assert NO_WALLS.tangent_first(4.0, 3.0, 2.5) == (4.0, 3.0)


# --- point masses that obey ---

DT_S, LAG_S, FULL_MPS2 = 0.02, 0.15, 3.5
"""A lag as of an attitude loop of 7 rad/s, and the acceleration that a tilt of 0.35 rad gives."""


@dataclass
class Mass:
    """Point mass whose acceleration follows the command with a lag; it flies to a target as fast as it may."""

    place: list[float]
    target: Vec3
    speed_mps: float
    obeys: bool = True
    velocity: list[float] = None  # type: ignore[assignment]
    accel: list[float] = None  # type: ignore[assignment]
    command: list[float] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        self.velocity, self.accel, self.command = ([0.0, 0.0, 0.0] for _ in range(3))

    @property
    def seen(self) -> OtherVehicle:
        x, y, z = self.place
        vx, vy, vz = self.velocity
        return other((x, y, z), (vx, vy, vz))

    def wish(self) -> Vec3:
        """Full throttle towards the target, and no braking for anybody."""
        way = [there - here for there, here in zip(self.target, self.place, strict=True)]
        left_m = math.hypot(*way) or 1.0
        speed_mps = min(self.speed_mps, math.sqrt(2.0 * left_m))
        x, y, z = (3.0 * (speed_mps * w / left_m - v) for w, v in zip(way, self.velocity, strict=True))
        return x, y, z

    def decide(self, cylinder: Separation, others: list[OtherVehicle]) -> None:
        x, y, z = self.wish()
        if self.obeys:
            px, py, pz = self.place
            vx, vy, vz = self.velocity
            ax, ay, az = (0.5 * (a + c) for a, c in zip(self.accel, self.command, strict=True))
            walls = cylinder.walls((px, py, pz), (vx, vy, vz), (ax, ay, az), others)
            x, y = walls.tangent_first(*walls.behind(x, y, FULL_MPS2), FULL_MPS2)
            z = max(walls.least_up_mps2, min(walls.most_up_mps2, z))
        size = max(math.hypot(x, y) / FULL_MPS2, 1.0)
        self.command = [x / size, y / size, max(-4.9, min(4.9, z))]

    def move(self) -> None:
        for axis in range(3):
            self.accel[axis] += (self.command[axis] - self.accel[axis]) * DT_S / LAG_S
            self.velocity[axis] += self.accel[axis] * DT_S
            self.place[axis] += self.velocity[axis] * DT_S


def least_gap_m(masses: list[Mass], for_s: float) -> float:
    """Fly all of them; the guard's own margin of 5 cm belongs to the cylinder that they keep."""
    kept, least_m = CYLINDER.widened(0.05), math.inf
    for _ in range(round(for_s / DT_S)):
        seen = [mass.seen for mass in masses]
        for index, mass in enumerate(masses):
            mass.decide(kept, seen[:index] + seen[index + 1 :])
        for mass in masses:
            mass.move()
        for index, mass in enumerate(masses):
            x, y, z = mass.place
            least_m = min([least_m, *(CYLINDER.gap_m((x, y, z), one.seen) for one in masses[:index])])
    return least_m


@pytest.mark.parametrize(
    ("first", "to", "second", "and_to"),
    [
        ((-4.0, 0.0, 1.0), (4.0, 0.0, 1.0), (4.0, 0.0, 1.0), (-4.0, 0.0, 1.0)),
        ((-4.0, 0.0, 1.0), (4.0, 0.0, 1.0), (0.0, -4.0, 1.0), (0.0, 4.0, 1.0)),
        ((-4.0, 0.0, 1.0), (4.0, 0.0, 1.0), (-2.5, 0.0, 1.0), (-1.0, 0.0, 1.0)),
        ((-4.0, 0.0, 1.0), (4.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
        ((0.0, 0.0, 3.4), (0.0, 0.0, 0.5), (0.2, 0.0, 0.5), (0.2, 0.0, 3.4)),
        ((-3.0, 0.0, 3.2), (0.0, 0.0, 0.8), (0.0, 0.0, 0.8), (0.0, 0.0, 3.2)),
    ],
    ids=["head-on", "crossing", "overtaking", "at one that hovers", "one above the other", "descending onto it"],
)
@pytest.mark.parametrize("speed_mps", [0.5, 1.0, 1.5])
def test_two_that_obey_stay_out_of_the_cylinder(
    first: Vec3, to: Vec3, second: Vec3, and_to: Vec3, speed_mps: float
) -> None:
    masses = [Mass(list(first), to, speed_mps), Mass(list(second), and_to, speed_mps)]
    assert least_gap_m(masses, 12.0) > 0.0


places = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.5, 3.4))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), targets=st.lists(places, min_size=2, max_size=3))
def test_any_two_or_three_that_obey_stay_out_of_each_others_cylinder(seed: int, targets: list[Vec3]) -> None:
    draw, masses = random.Random(seed), list[Mass]()
    for target in targets:
        mass = Mass([draw.uniform(-4.0, 4.0), draw.uniform(-4.0, 4.0), 1.0], target, draw.uniform(0.3, 1.5))
        while any(CYLINDER.widened(0.1).gap_m((*mass.place,), one.seen) < 0.0 for one in masses):  # type: ignore[arg-type]
            mass.place[:2] = draw.uniform(-4.0, 4.0), draw.uniform(-4.0, 4.0)
        masses.append(mass)
    assert least_gap_m(masses, 8.0) > 0.0


@pytest.mark.parametrize("speed_mps", [0.3, 0.7, 1.0])
def test_one_that_obeys_backs_away_from_one_that_does_not(speed_mps: float) -> None:
    """A pilot, a service that has stopped, or PX4's landing that drifts."""
    hovers = Mass([0.0, 0.1, 1.2], (0.0, 0.1, 1.2), 1.0)
    comes = Mass([-4.0, 0.0, 1.2], (40.0, 0.0, 1.2), speed_mps, obeys=False)
    assert least_gap_m([hovers, comes], 10.0) > -0.1
