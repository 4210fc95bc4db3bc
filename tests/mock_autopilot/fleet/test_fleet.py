"""Several vehicles in one room: ports by rule, one clock, downwash, collisions, and whose faults are whose."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.faults.mocap import FleetMocapFaults, MocapFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.faults.sentences import parse, sentence_of
from mock_autopilot.fleet.config import body_names, vehicle_config
from mock_autopilot.fleet.fleet import Collision, Fleet
from mock_autopilot.mavlink.link import MavlinkLink
from mock_autopilot.physics.downwash import ROTOR_AREA_M2, mean_push_n, mean_torque_nm
from mock_autopilot.physics.truth import Truth
from mock_autopilot.px4.setpoint import LEVEL, AttitudeTarget
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import Body, BodyPose, Frame
from mock_autopilot.world import STEP_S, World
from tests.mock_autopilot.qtm.truths import truth_at

WEIGHT_N = 4.85 * 9.80665


def _config(vehicles: int = 2, fleet: Mapping[str, Any] | None = None, **tables: Any) -> MockConfig:
    return MockConfig.from_dict({"fleet": {"vehicles": vehicles, **(fleet or {})}, **tables})


def _hover(world: World, thrust: float = 0.5) -> None:
    """Send a level setpoint; arm with the first."""
    world.vehicle.attitude_target(AttitudeTarget(7, LEVEL, (0.0, 0.0, 0.0), thrust))
    if not world.vehicle.armed:
        world.vehicle.set_mode(1, 6, 0)
        world.vehicle.arm_disarm(1.0, 21196.0)


def test_the_second_vehicles_ports_names_and_place_are_the_first_ones_plus_one() -> None:
    config = _config(arms={"enabled": True, "bus": {"link": "/tmp/bus"}})
    first, second = vehicle_config(config, 1), vehicle_config(config, 2)
    assert (first.mavlink.remote_port, first.mavlink.local_port, first.gcs.local_port) == (14540, 14580, 18570)
    assert (second.mavlink.remote_port, second.mavlink.local_port, second.gcs.local_port) == (14541, 14581, 18571)
    assert second.gcs.remote_port == 14550
    assert [one.px4.params["MAV_SYS_ID"] for one in (first, second)] == [1, 2]
    assert [one.arms.bus.link for one in (first, second)] == ["/tmp/bus-1", "/tmp/bus-2"]
    assert [one.vehicle.start_position_ned_m for one in (first, second)] == [(0.0, 0.8, 0.0), (0.0, -0.8, 0.0)]
    assert body_names(config) == ("dauam-1", "dauam-2")


def test_a_single_vehicles_settings_are_not_touched() -> None:
    config = MockConfig()
    assert vehicle_config(config, 1) is config
    assert body_names(config) == ("dauam",)


def test_each_autopilot_has_its_own_system_id_and_answers_to_it_alone() -> None:
    for number, world in enumerate(Fleet(_config()).worlds, start=1):
        assert MavlinkLink(vehicle_config(_config(), number).mavlink, world)._codec.srcSystem == number


def test_a_port_beyond_the_last_is_refused() -> None:
    with pytest.raises(MockConfigError, match=r"mavlink\.remote_port = 65535: vehicle 2 would have port 65536"):
        _config(mavlink={"remote_port": 65535})


def test_the_same_seed_gives_the_same_truths_and_each_vehicle_its_own_wind() -> None:
    windy = _config(disturbance={"noise_n": (1.0, 1.0, 1.0)})
    flown = []
    for _ in range(2):
        fleet = Fleet(windy, seed=3)
        seen: list[tuple[Truth, ...]] = []
        fleet.observers.append(seen.append)
        for _ in range(100):
            for world in fleet.worlds:
                _hover(world, 0.6)
            fleet.advance(fleet.time_s + 0.02)
        flown.append(seen)
        assert len(seen) == round(2.0 / STEP_S)
    for (a, b), (c, d) in zip(*flown, strict=True):
        assert np.array_equal(a.position_ned_m, c.position_ned_m)
        assert np.array_equal(b.position_ned_m, d.position_ned_m)
    first, second = flown[0][-1]
    assert first.position_ned_m[0] != second.position_ned_m[0]


def test_the_jet_keeps_the_momentum_of_the_thrust() -> None:
    for below_m in (0.5, 1.5, 3.0):
        beside_m = np.linspace(0.0, 5.0, 2001)
        flux_npm2 = np.array([mean_push_n(WEIGHT_N, below_m, float(r)) for r in beside_m]) / ROTOR_AREA_M2
        total_n = np.trapezoid(flux_npm2 * 2.0 * math.pi * beside_m, beside_m)
        assert total_n == pytest.approx(WEIGHT_N, rel=1e-3)


def test_the_push_falls_with_the_distance_below_and_beside() -> None:
    assert mean_push_n(WEIGHT_N, 1.6, 0.0) == pytest.approx(15.1, abs=0.2)
    assert mean_push_n(WEIGHT_N, 1.6, 1.0) == pytest.approx(1.0, abs=0.1)
    assert mean_push_n(WEIGHT_N, 3.0, 0.0) < mean_push_n(WEIGHT_N, 1.6, 0.0) < mean_push_n(WEIGHT_N, 0.5, 0.0)
    assert mean_push_n(WEIGHT_N, -0.1, 0.0) == 0.0


def test_the_near_side_is_pushed_down_more() -> None:
    about_north_nm, about_east_nm = mean_torque_nm(10.0, 1.0, (0.0, 0.5))  # the axis is in the east
    assert about_north_nm > 0.0  # the east goes down: right roll, heading north
    assert about_east_nm == 0.0


def _stacked(downwash: bool, for_s: float = 0.5) -> tuple[Fleet, float]:
    """Hover one 1.5 m above the other; return the fleet and how far the lower one has sunk, m."""
    fleet = Fleet(_config(fleet={"downwash": downwash}))
    for world, height_m in zip(fleet.worlds, (3.0, 1.5), strict=True):
        world.carry((0.0, 0.0, -height_m))
    fleet.advance(1.0)
    for _ in range(25):
        for world in fleet.worlds:
            world._handling.holds = True  # until the rotors turn
            _hover(world)
        fleet.advance(fleet.time_s + 0.02)
    before_m = fleet.worlds[1].position_ned_m[2]
    for _ in range(round(for_s / 0.02)):
        for world in fleet.worlds:
            _hover(world)
        fleet.advance(fleet.time_s + 0.02)
    return fleet, fleet.worlds[1].position_ned_m[2] - before_m


def test_the_lower_vehicle_is_pushed_down_and_the_upper_one_is_not() -> None:
    fleet, sunk_m = _stacked(downwash=True)
    _, calm_m = _stacked(downwash=False)
    assert sunk_m - calm_m > 0.1
    assert fleet.worlds[0].air_push is None
    assert fleet.worlds[1].air_push is not None


def test_bodies_that_overlap_stop_both_for_good_and_are_told() -> None:
    fleet = Fleet(_config())
    told: list[Collision] = []
    fleet.collision_observers.append(told.append)
    fleet.advance(2.5)
    assert not fleet.collisions
    flying, parked = fleet.worlds
    for _ in range(50):
        _hover(flying, 0.55)
        fleet.advance(fleet.time_s + 0.02)
    x, y, _ = parked.position_ned_m
    parked.carry((x, y + 0.7, flying.position_ned_m[2]))  # into the other's way
    for _ in range(100):
        _hover(flying, 0.5)
        fleet.advance(fleet.time_s + 0.02)
    assert [met.bodies for met in fleet.collisions] == [("dauam-1", "dauam-2")] == [met.bodies for met in told]
    assert not flying.vehicle.armed
    assert flying.truth.on_ground
    for world, other in ((flying, "dauam-2"), (parked, "dauam-1")):
        assert f"Collision with {other}: motors stopped" in " ".join(t.text for t in world.vehicle.pop_texts())
        world.vehicle.arm_disarm(1.0, 21196.0)
        assert not world.vehicle.armed


def test_vehicles_beside_each_other_on_the_ground_do_not_collide() -> None:
    fleet = Fleet(_config(3))
    fleet.advance(0.5)
    assert not fleet.collisions


def test_a_fault_names_its_vehicle() -> None:
    fault = parse("Vehicle 2: mocap stuck at 12 s for 2 s")
    assert fault.vehicle == 2
    assert parse(sentence_of(fault)) == fault
    assert sentence_of(fault) == "vehicle 2: mocap stuck at 12 s for 2 s"
    assert parse("mocap stuck").vehicle is None
    config = _config(faults=[{"say": "vehicle 2: link off"}, {"say": "mocap off"}])
    assert [[sentence_of(fault) for fault in vehicle_config(config, n).faults] for n in (1, 2)] == [
        ["mocap off"],
        ["vehicle 2: link off"],
    ]


@pytest.mark.parametrize(("vehicles", "there"), [(1, "is one vehicle"), (2, "are 2 vehicles")])
def test_a_fault_of_a_vehicle_that_is_not_there_is_refused(vehicles: int, there: str) -> None:
    with pytest.raises(MockConfigError, match=f"vehicle 3 cannot have a fault: there {there}"):
        _config(vehicles, faults=[{"say": "vehicle 3: mocap off"}])


def test_the_cameras_see_every_vehicle_and_the_first_as_without_the_others() -> None:
    alone, both = Camera(QualisysConfig(), 5), Camera(QualisysConfig(extra_bodies=("b", "standing")), 5)
    for k in range(20):
        truth, other = truth_at(k * 0.002, (1.0, 0.0, -1.0)), truth_at(k * 0.002, (0.0, -2.0, -0.5))
        for one, many in zip(alone.look(truth), both.look(truth, [other]), strict=True):
            ours, second, standing = many.bodies
            assert np.array_equal(ours.position_room_m, one.bodies[0].position_room_m)
            assert second.position_room_m == pytest.approx([0.0, 2.0, 0.5], abs=0.002)
            assert standing.position_room_m.tolist() == [1.0, 2.0, 0.0]


def _frame(number: int) -> Frame:
    return Frame(number, number * 10_000, tuple(BodyPose(np.full(3, float(n)), np.eye(3), 0.001) for n in (1, 2, 3)))


def _through(*sentences: str) -> tuple[FleetMocapFaults, list[FaultSchedule]]:
    schedules = [FaultSchedule(), FaultSchedule()]
    rng = np.random.default_rng(1)
    faults = FleetMocapFaults([MocapFaults(one, rng, 100.0, n, alone=True) for n, one in enumerate(schedules)])
    for sentence in sentences:
        fault = parse(sentence)
        schedules[(fault.vehicle or 1) - 1].inject(fault, 0.0)
    return faults, schedules


def _places(frame: Frame) -> list[float]:
    return [float(body.position_room_m[2]) for body in frame.bodies]


@pytest.mark.parametrize(
    ("sentence", "seen"),
    [
        ("vehicle 2: mocap wrong (lost)", [1.0, math.nan, 3.0]),
        ("mocap wrong (lost)", [math.nan, 2.0, 3.0]),
        ("vehicle 2: mocap wrong (body deleted)", [1.0, 3.0]),
        ("vehicle 2: mocap wrong (body disabled)", [1.0, math.nan, 3.0]),
        ("vehicle 2: mocap wrong (no bodies)", []),
    ],
)
def test_a_fault_of_a_pose_is_that_vehicles_alone(sentence: str, seen: list[float]) -> None:
    faults, _ = _through(sentence)
    (frame,) = faults.pass_on([_frame(1)], 0.01)
    assert _places(frame) == pytest.approx(seen, nan_ok=True)


def test_a_vehicle_of_a_fleet_is_stuck_alone() -> None:
    faults, _ = _through("vehicle 2: mocap stuck")
    faults.pass_on([_frame(1)], 0.01)
    moved = Frame(2, 20_000, tuple(BodyPose(np.full(3, 9.0), np.eye(3), 0.001) for _ in range(3)))
    (frame,) = faults.pass_on([moved], 0.02)
    assert _places(frame) == [9.0, 2.0, 9.0]


def test_faults_of_two_vehicles_meet_in_one_list() -> None:
    faults, _ = _through("vehicle 2: mocap wrong (body deleted)", "mocap wrong (lost)")
    (frame,) = faults.pass_on([_frame(1)], 0.01)
    assert _places(frame) == pytest.approx([math.nan, 3.0], nan_ok=True)
    assert [body.name for body in faults.listed((Body("a"), Body("b"), Body("c")))] == ["a", "c"]
    assert not faults.breaks_packets
    assert faults.packet(b"as it is") == b"as it is"


def test_a_fault_of_the_stream_reaches_everybody() -> None:
    faults, _ = _through("vehicle 2: mocap off")
    assert faults.pass_on([_frame(1)], 0.01) == []
