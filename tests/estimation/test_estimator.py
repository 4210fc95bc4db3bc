"""Estimator with good frames: noise, delay, accuracy."""

from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import Array, VehicleState
from companion.estimation.estimator import EstimatorState, Verdict, age_s, step
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector, quat_from_yaw
from tests.estimation.flights import DELAY_S, NOISELESS, OFFSET_S, PARAMS, Sway, followed, frame, noisy

VEHICLE_RADPS = 6.3
"""Bandwidth of the attitude loop that is to be controlled."""


def vehicle(state: EstimatorState) -> VehicleState:
    assert state.vehicle is not None
    return state.vehicle


def lag_s_and_gain(values: Array, times_s: Array, radps: float, amplitude: float) -> tuple[float, float]:
    """Return the delay (s) and the gain with which `values` follow amplitude * cos(radps t)."""
    waves = np.stack((np.cos(radps * times_s), np.sin(radps * times_s)), axis=1)
    cosine, sine = np.linalg.lstsq(waves, values, rcond=None)[0]
    return float(np.arctan2(sine, cosine) / radps), float(np.hypot(cosine, sine) / amplitude)


def swayed(radps: float) -> tuple[Array, Array, Array]:
    """Times (s), velocities (m/s) and body rates (rad/s) of a long sway, after its start."""
    states = followed(noisy(Sway(radps), 3000))[300:]
    times_s = np.array([state.stamp_s for state in states])
    return (
        times_s,
        np.array([vehicle(s).velocity_w_mps for s in states]),
        np.array([vehicle(s).rate_flu_radps for s in states]),
    )


def test_velocity_noise_is_below_a_centimetre_per_second() -> None:
    _, velocities, rates = swayed(VEHICLE_RADPS)
    assert velocities[:, 1:].std() < 0.010
    assert rates[:, 1:].std() < 0.060


def test_lag_is_small_at_the_vehicles_bandwidth() -> None:
    sway = Sway(VEHICLE_RADPS)
    times_s, velocities, rates = swayed(VEHICLE_RADPS)
    lag_s, gain = lag_s_and_gain(velocities[:, 0], times_s, VEHICLE_RADPS, sway.speed_mps)
    assert abs(lag_s) < 0.003
    assert gain == pytest.approx(1.0, abs=0.06)
    lag_s, gain = lag_s_and_gain(rates[:, 0], times_s, VEHICLE_RADPS, sway.tilt_rad * VEHICLE_RADPS)
    assert abs(lag_s) < 0.004
    assert gain == pytest.approx(1.0, abs=0.08)


def test_a_known_acceleration_makes_it_quieter_without_making_it_later() -> None:
    sway, calm = Sway(VEHICLE_RADPS), replace(PARAMS, jerk_density=0.05)
    states = followed(noisy(sway, 3000), calm, accel_input=sway.acceleration_mps2)[300:]
    times_s = np.array([state.stamp_s for state in states])
    velocities = np.array([vehicle(s).velocity_w_mps for s in states])
    assert velocities[:, 1:].std() < 0.005
    lag_s, gain = lag_s_and_gain(velocities[:, 0], times_s, VEHICLE_RADPS, sway.speed_mps)
    assert abs(lag_s) < 0.001
    assert gain == pytest.approx(1.0, abs=0.01)


def test_every_second_frame_lost_still_follows() -> None:
    kept = [taken for taken in noisy(Sway(3.0), 2000) if taken.frame % 2 == 0 or taken.frame % 7 == 0]
    errors = [vehicle(s).velocity_w_mps - Sway(3.0).velocity_mps(s.stamp_s) for s in followed(kept)[150:]]
    assert np.std(errors) < 0.015


def test_the_state_is_dated_at_its_capture_on_our_clock() -> None:
    (state,) = followed([frame(7)])
    assert vehicle(state).time_s == pytest.approx(0.07 + OFFSET_S)
    assert age_s(state, 0.07 + OFFSET_S + 0.02) == pytest.approx(0.02)


def test_age_is_infinite_before_the_first_frame() -> None:
    assert age_s(EstimatorState(), 5.0) == np.inf
    assert EstimatorState().velocity_std_mps == np.inf


@pytest.mark.parametrize("vector", [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 3.1), (1.0, 2.0, -1.5)])
def test_a_still_attitude_is_taken_as_it_is(vector: tuple[float, float, float]) -> None:
    q = quat_from_rotation_vector(np.array(vector))
    states = followed([frame(k, q=q) for k in range(5)], NOISELESS)
    np.testing.assert_allclose(matrix_from_quat(vehicle(states[-1]).q_w_flu_wxyz), matrix_from_quat(q), atol=1e-12)
    np.testing.assert_allclose(vehicle(states[-1]).rate_flu_radps, 0.0, atol=1e-9)


@pytest.mark.parametrize(("axis", "rate_radps"), [(0, 1.0), (1, -2.0), (2, 4.0)])
def test_a_steady_turn_is_found_in_body_axes(axis: int, rate_radps: float) -> None:
    """Also past half a turn, where quaternions change their sign."""
    rate = np.zeros(3)
    rate[axis] = rate_radps
    frames = [frame(k, q=quat_from_rotation_vector(0.01 * k * rate)) for k in range(200)]
    np.testing.assert_allclose(vehicle(followed(frames)[-1]).rate_flu_radps, rate, atol=1e-6)


def test_body_rates_are_about_the_bodys_axes_not_the_rooms() -> None:
    """Heading west and rolling about the nose: in the room that is a turn about y, in the body about x."""
    west = quat_from_yaw(np.pi / 2)
    turned = [quat_from_rotation_vector(np.array([0.0, 0.01 * k, 0.0])) for k in range(100)]
    frames = [
        replace(frame(k), rotation_w_b=matrix_from_quat(q) @ matrix_from_quat(west)) for k, q in enumerate(turned)
    ]
    np.testing.assert_allclose(vehicle(followed(frames)[-1]).rate_flu_radps, (1.0, 0.0, 0.0), atol=1e-6)


def test_the_velocity_is_known_after_a_tenth_of_a_second() -> None:
    states = followed(frame(k, (0.02 * k, 0.0, 1.0)) for k in range(11))
    assert states[0].velocity_std_mps == pytest.approx(1.0)
    assert states[-1].velocity_std_mps < 0.03
    np.testing.assert_allclose(vehicle(states[-1]).velocity_w_mps, (2.0, 0.0, 0.0), atol=0.01)


def test_a_step_leaves_what_it_was_given_alone() -> None:
    frames = noisy(Sway(3.0), 20)
    state = followed(frames[:10])[-1]
    first = step(state, frames[10], PARAMS)
    again = step(state, frames[10], PARAMS)
    assert first.verdict is Verdict.ACCEPTED
    np.testing.assert_array_equal(vehicle(first).velocity_w_mps, vehicle(again).velocity_w_mps)
    assert state.counts.accepted + state.counts.started == 10


def test_arrival_jitter_does_not_reach_the_estimate() -> None:
    frames = noisy(Sway(3.0), 300)
    late = [replace(taken, received_s=taken.received_s + 0.004 * (k % 5)) for k, taken in enumerate(frames)]
    on_time, jittered = vehicle(followed(frames)[-1]), vehicle(followed(late)[-1])
    np.testing.assert_array_equal(on_time.velocity_w_mps, jittered.velocity_w_mps)
    assert jittered.time_s == pytest.approx(on_time.time_s, abs=1e-9)
    assert jittered.time_s == pytest.approx(2.99 + OFFSET_S, abs=1e-9), f"the least delay of {DELAY_S} s is known"
