"""One truth and one clock: determinism, disturbances, delays, the hook for outside forces."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mock_autopilot.config import MockConfig
from mock_autopilot.physics import plant
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.plant import GRAVITY_MPS2, Wrench
from mock_autopilot.physics.truth import Truth
from mock_autopilot.px4.setpoint import LEVEL, AttitudeTarget
from mock_autopilot.world import STEP_S, World
from tests.mock_autopilot.bench import NO_GPS, Bench

WINDY: dict[str, Any] = {
    "disturbance": {
        "constant_ned_n": (0.4, -0.3, 0.0),
        "noise_n": (0.2, 0.2, 0.2),
        "sinusoids": [{"amplitude_ned_n": (1.4, 0.0, 0.0), "period_s": 9.0}],
    }
}


def _world(config: Mapping[str, Any] | None = None, seed: int = 1) -> World:
    return World(MockConfig.from_dict(dict(config or {})), seed)


def _offboard(world: World, thrust: float, for_s: float, roll_rad: float = 0.0) -> None:
    """Keep a setpoint alive at 50 Hz; arms on the first call."""
    w, x, y, z = quat.from_euler(roll_rad, 0.0, 0.0).tolist()
    for _ in range(round(for_s / 0.02)):
        world.vehicle.attitude_target(AttitudeTarget(7, (w, x, y, z), (0.0, 0.0, 0.0), thrust))
        if not world.vehicle.armed:
            world.vehicle.set_mode(1, 6, 0)
            world.vehicle.arm_disarm(1.0, 0.0)
        world.advance(world.time_s + 0.02)


def _flown(config: Mapping[str, Any], seed: int) -> bytes:
    world, trace = _world(config, seed), []
    world.observers.append(lambda truth: trace.append(np.concatenate((truth.position_ned_m, truth.q_ned_frd_wxyz))))
    world.advance(4.2)
    _offboard(world, 0.55, 2.0, roll_rad=0.05)
    return np.array(trace).tobytes()


def test_the_same_seed_and_inputs_give_the_same_bytes() -> None:
    assert _flown(WINDY, 7) == _flown(WINDY, 7)


def test_another_seed_gives_another_flight() -> None:
    assert _flown(WINDY, 7) != _flown(WINDY, 8)


def test_the_size_of_the_strides_does_not_matter() -> None:
    one, many = _world(WINDY), _world(WINDY)
    one.advance(3.0)
    while many.time_s < 3.0 - 1e-9:
        many.advance(many.time_s + 0.0067)
    many.advance(3.0)
    assert np.array_equal(one.truth.position_ned_m, many.truth.position_ned_m)
    assert one.time_s == many.time_s


def test_time_never_goes_back() -> None:
    world = _world()
    world.advance(1.0)
    world.advance(0.5)
    assert world.time_s == pytest.approx(1.0)


def test_observers_see_every_step_in_order() -> None:
    world, seen = _world(), list[Truth]()
    world.observers.append(seen.append)
    world.advance(0.1)
    assert [truth.time_s for truth in seen] == pytest.approx([STEP_S * n for n in range(1, 51)])


def test_it_starts_where_and_how_it_was_put() -> None:
    world = _world({"vehicle": {"start_position_ned_m": (1.0, -2.0, 0.0), "start_yaw_rad": 0.7}})
    world.advance(1.0)
    assert world.truth.position_ned_m == pytest.approx([1.0, -2.0, 0.0])
    assert quat.yaw_of(world.truth.q_ned_frd_wxyz) == pytest.approx(0.7)
    assert world.truth.on_ground


def test_an_outside_force_moves_it_and_stays_until_it_is_changed() -> None:
    world = _world({"plant": {"coulomb_n": (0.0, 0.0, 0.0)}})
    world.advance(4.2)
    _offboard(world, 0.55, 3.0)
    world.external_wrench = Wrench(np.array([2.0, 0.0, 0.0]), np.zeros(3))
    _offboard(world, 0.5, 2.0)
    pushed = world.truth.velocity_ned_mps[0]
    world.external_wrench = plant.no_wrench()
    _offboard(world, 0.5, 2.0)
    assert pushed > 0.5
    assert world.truth.velocity_ned_mps[0] < pushed


def test_a_disturbance_does_not_push_a_standing_vehicle_away() -> None:
    world = _world(WINDY)
    world.advance(4.0)
    assert world.truth.position_ned_m == pytest.approx(np.zeros(3))


def test_a_setpoint_takes_its_delay_to_the_motors() -> None:
    world = _world({"vehicle": {"thrust_delay_s": 0.1, "attitude_delay_s": 0.1}})
    world.advance(4.2)
    world.vehicle.attitude_target(AttitudeTarget(7, LEVEL, (0.0, 0.0, 0.0), 0.7))
    world.vehicle.set_mode(1, 6, 0)
    world.vehicle.arm_disarm(1.0, 0.0)
    world.advance(4.298)
    assert float(world.state.thrust_n) == 0.0
    world.advance(4.31)
    assert float(world.state.thrust_n) > 0.0


@pytest.mark.parametrize("factor", [0.0, 0.3, 1.0])
def test_thr_mdl_fac_undoes_the_motor_curve(factor: float) -> None:
    world = _world({"plant": {"motor_curve": factor}, "px4": {"params": {"THR_MDL_FAC": factor}}})
    world.advance(4.2)
    _offboard(world, 0.5, 1.0)
    assert float(world.state.thrust_n) == pytest.approx(4.85 * GRAVITY_MPS2, rel=1e-6)


def test_without_heading_the_setpoints_turn_with_the_belief() -> None:
    """No magnetometer and no vision: a vehicle facing east believes to face north."""
    bench = Bench(NO_GPS, vehicle={"start_yaw_rad": 1.5707963})
    bench.run(2.0)
    assert bench.world.vehicle.estimate.yaw_rad == pytest.approx(0.0, abs=1e-6)
    bench.vision = True
    bench.run(1.0)
    assert bench.world.vehicle.estimate.yaw_rad == pytest.approx(1.5707963, abs=1e-3)


def test_the_estimate_follows_the_vision_while_it_moves() -> None:
    bench = Bench(NO_GPS)
    bench.vision = True
    bench.run(4.2)
    bench.fly_offboard(2.0)
    w, x, y, z = quat.from_euler(0.1, 0.0, 0.0).tolist()
    bench.target(0.5, (w, x, y, z))
    bench.run(2.0)
    assert bench.world.truth.velocity_ned_mps[1] > 1.0
    assert np.allclose(bench.world.vehicle.estimate.position_m, bench.world.truth.position_ned_m, atol=0.1)
    assert np.allclose(bench.world.vehicle.estimate.velocity_mps, bench.world.truth.velocity_ned_mps, atol=0.2)
