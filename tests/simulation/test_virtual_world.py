"""Simulated effects on setpoints and frames: delays, noise, drop-outs, forces, and the size of its steps."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.types import Array, AttitudeThrust
from companion.geometry.frames import flip_quat, flip_yz, quat_from_rotation_vector
from companion.simulation import virtual_world
from companion.simulation.virtual_world import STEP_S, VirtualVehicle, VirtualWorld
from mock_autopilot.physics.disturbance import Forces
from mock_autopilot.physics.plant import PlantParams
from mock_autopilot.px4.attitude_error import AttitudeErrorParams, AttitudeErrorSource

START = np.array([0.0, 0.0, 1.2])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
LEANING = quat_from_rotation_vector(np.array([0.1, -0.2, 0.0]))
STILL = VirtualVehicle(noise_m=0.0, noise_rad=0.0)
HOVER = AttitudeThrust(LEVEL, np.asarray(0.5))
LEAN = AttitudeThrust(LEANING, np.asarray(0.6))
DELAYS = st.integers(0, 12).map(lambda steps: steps * STEP_S)


def world_of(vehicle: VirtualVehicle, cycles: int, lead: tuple[int, ...] = (), seed: int = 1) -> VirtualWorld:
    """One that looks at every step, so that delays of any number of steps are seen."""
    seeds = range(seed, seed + (lead[0] if lead else 1))
    return VirtualWorld(vehicle, np.broadcast_to(START, (*lead, 3)), list(seeds), cycles, STEP_S)


def spread(setpoint: AttitudeThrust, count: int) -> AttitudeThrust:
    return AttitudeThrust(np.broadcast_to(setpoint.q_w_flu_wxyz, (count, 4)), np.full(count, float(setpoint.thrust)))


def state_bytes(world: VirtualWorld) -> bytes:
    return b"".join(np.asarray(value).tobytes() for value in vars(world.state).values())


@settings(max_examples=20)
@given(DELAYS)
def test_motion_capture_sees_exactly_what_was_true_a_delay_ago(delay_s: float) -> None:
    cycles, delay = 30, round(delay_s / STEP_S)
    world = world_of(replace(STILL, mocap_delay_s=delay_s), cycles)
    truths = []
    for cycle in range(cycles):
        truths.append((flip_yz(world.state.position_ned_m), flip_quat(world.state.q_ned_frd_wxyz)))
        seen, (position, q) = world.look(), truths[max(cycle - delay, 0)]
        assert seen.position_w_m.tolist() == position.tolist()
        assert seen.q_w_flu_wxyz.tolist() == q.tolist()
        world.advance(LEAN)
    assert truths[-1][0][0] != START[0], "or else there was nothing to see"


@settings(max_examples=20)
@given(DELAYS, DELAYS)
def test_a_setpoint_acts_after_its_delay_and_not_a_step_before(attitude_s: float, thrust_s: float) -> None:
    vehicle = replace(STILL, attitude_delay_s=attitude_s, thrust_delay_s=thrust_s)
    worlds = [world_of(vehicle, 40) for _ in range(3)]
    asked = (HOVER, AttitudeThrust(LEANING, HOVER.thrust), AttitudeThrust(LEVEL, LEAN.thrust))
    differs: dict[int, int] = {}
    for step in range(40):
        for world, setpoint in zip(worlds, asked, strict=True):
            world.advance(HOVER if step < 10 else setpoint)
        for which in (1, 2):
            if state_bytes(worlds[which]) != state_bytes(worlds[0]):
                differs.setdefault(which, step - 10)
    assert differs == {1: round(attitude_s / STEP_S), 2: round(thrust_s / STEP_S)}


def test_a_batch_has_a_delay_for_each_vehicle() -> None:
    delays_s = np.array([0.0, 0.01, 0.04])

    def late(seen_s: Any, heard_s: Any) -> VirtualVehicle:
        return replace(STILL, mocap_delay_s=seen_s, attitude_delay_s=heard_s, thrust_delay_s=seen_s)

    batch = world_of(late(delays_s, delays_s[::-1]), 30, (3,))
    alone = [world_of(late(*pair), 30) for pair in zip(delays_s, delays_s[::-1], strict=True)]
    for step in range(30):
        setpoint = HOVER if step < 5 else LEAN
        seen = batch.look()
        for k, world in enumerate(alone):
            assert seen.position_w_m[k] == pytest.approx(world.look().position_w_m, abs=1e-12)
            world.advance(setpoint)
        batch.advance(spread(setpoint, 3))
    leaned = np.abs(batch.state.q_ned_frd_wxyz[:, 2])
    assert leaned[0] < leaned[1] < leaned[2], "who hears of the lean later has leaned less: delays 40, 10 and 0 ms"


@pytest.mark.parametrize(("curve", "mass_kg"), [(0.0, 4.85), (0.4, 4.0), (1.0, 6.0)])
def test_it_hovers_until_the_first_setpoint_arrives(curve: float, mass_kg: float) -> None:
    plant = PlantParams(mass_kg=mass_kg, motor_curve=curve)
    world = world_of(replace(STILL, plant=plant, attitude_delay_s=0.3, thrust_delay_s=0.3), 61)
    for _ in range(60):
        world.advance(AttitudeThrust(LEANING, np.asarray(0.0)))
    assert world.state.position_ned_m == pytest.approx(flip_yz(START), abs=1e-12)
    world.advance(HOVER)
    assert world.state.velocity_ned_mps[2] > 1e-4, "the motors hear that they are to stop"


def test_noise_has_the_size_asked_for_and_comes_from_the_seed() -> None:
    vehicle = replace(STILL, noise_m=0.002, noise_rad=0.01)
    world = world_of(vehicle, 4000)
    offsets, turns = [], []
    for _ in range(4000):
        seen = world.look()
        offsets.append(seen.position_w_m - START)
        turns.append(2.0 * seen.q_w_flu_wxyz[1:])
        world.advance(HOVER)
    assert np.std(offsets, axis=0) == pytest.approx(0.002, rel=0.05)
    assert np.std(turns, axis=0) == pytest.approx(0.01, rel=0.05)
    assert np.abs(np.mean(offsets, axis=0)).max() < 4.0 * 0.002 / np.sqrt(4000)
    first = [world_of(vehicle, 1, seed=seed).look().position_w_m.tolist() for seed in (1, 1, 2)]
    assert first[0] == first[1] == (START + offsets[0]).tolist()
    assert first[0] != first[2]


def test_a_vehicle_of_a_batch_has_the_noise_and_the_forces_of_its_seed() -> None:
    vehicle = replace(STILL, noise_m=0.002, forces=Forces((1.0, 0.0, 0.0), noise_n=(0.3, 0.2, 0.1)))
    batch = world_of(replace(vehicle, force_scale=np.array([1.0, 0.5])), 50, (2,), seed=7)
    for k, scale in enumerate((1.0, 0.5)):
        alone = world_of(vehicle, 50, seed=7 + k)
        assert batch.force_ned_n[:, k] == pytest.approx(scale * alone.force_ned_n, abs=1e-12)
        assert batch.look().position_w_m[k] == pytest.approx(alone.look().position_w_m, abs=1e-12)
    assert not np.allclose(batch.force_ned_n[:, 0], 2.0 * batch.force_ned_n[:, 1])


def test_a_lost_frame_is_not_fresh() -> None:
    unseen = np.zeros((6, 2), dtype=bool)
    unseen[2:4, 1] = True
    world = world_of(replace(STILL, unseen=unseen), 6, (2,))
    fresh = []
    for _ in range(6):
        fresh.append(world.look().fresh.tolist())
        world.advance(spread(HOVER, 2))
    assert fresh == [[True, True]] * 2 + [[True, False]] * 2 + [[True, True]] * 2


def test_a_flight_begins_where_its_offset_says() -> None:
    offsets = np.array([[0.1, -0.2, 0.3], [0.0, 0.0, 0.0]])
    world = world_of(replace(STILL, offset_w_m=offsets), 1, (2,))
    assert world.look().position_w_m == pytest.approx(START + offsets, abs=1e-15)


def test_the_autopilot_holds_the_setpoint_in_its_own_horizon_and_reports_that() -> None:
    """Told to be level it believes to be; the truth leans by the error, and the vehicle is pushed that way."""
    vehicle = replace(STILL, attitude_error=AttitudeErrorParams(size_rad=0.03, time_s=1000.0))
    world = world_of(vehicle, 201)
    for _ in range(200):
        world.advance(HOVER)
    look, true = world.look(), world.state
    error_roll, error_pitch = -2.0 * true.q_ned_frd_wxyz[1:3]
    assert look.autopilot_q_w_flu_wxyz == pytest.approx(LEVEL, abs=1e-3)
    assert max(abs(error_roll), abs(error_pitch)) > 0.01
    north, east, _ = true.velocity_ned_mps
    assert (np.sign(north), np.sign(east)) == (np.sign(error_pitch), -np.sign(error_roll))


@settings(max_examples=10)
@given(DELAYS)
def test_the_autopilots_attitude_arrives_late_and_says_how_old_it_is(delay_s: float) -> None:
    cycles, delay = 30, round(delay_s / STEP_S)
    world = world_of(replace(STILL, report_delay_s=delay_s), cycles)
    truths = []
    for cycle in range(cycles):
        truths.append(flip_quat(world.state.q_ned_frd_wxyz).tolist())
        look = world.look()
        assert look.autopilot_q_w_flu_wxyz.tolist() == truths[max(cycle - delay, 0)]
        assert float(look.autopilot_age_s) == delay_s
        world.advance(LEAN)


@pytest.mark.parametrize("source", ["random", "px4-b"])
def test_a_horizon_errs_alike_alone_and_in_a_batch(source: AttitudeErrorSource) -> None:
    sizes_rad, times_s, late_s = np.array([0.01, 0.0, 0.03]), np.array([1.0, 5.0, 20.0]), np.array([0.0, 0.02, 0.05])

    def erring(size_rad: Any, time_s: Any, report_s: Any) -> VirtualVehicle:
        params = AttitudeErrorParams(source=source, size_rad=size_rad, time_s=time_s)
        return replace(STILL, attitude_error=params, report_delay_s=report_s)

    batch = world_of(erring(sizes_rad, times_s, late_s), 120, (3,), seed=7)
    alone = [
        world_of(erring(*own), 120, seed=7 + k) for k, own in enumerate(zip(sizes_rad, times_s, late_s, strict=True))
    ]
    perfect = world_of(STILL, 120, seed=8)
    for _ in range(120):
        together = batch.look()
        for k, world in enumerate(alone):
            assert together.autopilot_q_w_flu_wxyz[k] == pytest.approx(world.look().autopilot_q_w_flu_wxyz, abs=1e-12)
            assert batch.state.position_ned_m[k] == pytest.approx(world.state.position_ned_m, abs=1e-12)
            world.advance(LEAN)
        batch.advance(spread(LEAN, 3))
        perfect.advance(LEAN)
    assert state_bytes(alone[1]) == state_bytes(perfect), "a horizon without error changes nothing, to the last bit"
    assert together.autopilot_age_s.tolist() == late_s.tolist()


def _swerving(step_s: float, monkeypatch: pytest.MonkeyPatch) -> Array:
    """Return the path (m) of four seconds of leaning to and fro through a gust."""
    monkeypatch.setattr(virtual_world, "STEP_S", step_s)
    cycles = 400
    vehicle = replace(STILL, forces=Forces((0.8, -0.5, 0.2)))
    world = VirtualWorld(vehicle, START, [1], cycles, 0.01)
    path = []
    for cycle in range(cycles):
        sway = 0.3 * np.sin(2.0 * np.pi * cycle / 100.0)
        turn = quat_from_rotation_vector(np.array([0.5 * sway, sway, 0.0]))
        world.advance(AttitudeThrust(turn, np.asarray(0.51 + 0.05 * np.sin(cycle / 30.0))))
        path.append(flip_yz(world.state.position_ned_m))
    return np.array(path)


def test_steps_of_5_ms_are_fine_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse, fine = (_swerving(step_s, monkeypatch) for step_s in (STEP_S, 0.001))
    assert np.ptp(fine, axis=0).min() > 0.15, "it went somewhere on every axis"
    assert np.abs(coarse - fine).max() < 0.001
