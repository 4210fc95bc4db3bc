"""The batch against the estimator that flies, vehicle by vehicle, and against itself."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from companion.core.types import Array, MocapFrame
from companion.estimation import batch, estimator
from companion.estimation.batch import BatchEstimate
from companion.estimation.estimator import EstimatorState
from companion.geometry.frames import matrix_from_quat, quat_from_rotation_vector, quat_from_yaw, quat_multiply, yaw_of
from tests.estimation.flights import PARAMS

FRAMES, VEHICLES = 200, 6
PERIOD_S = 0.01


@dataclass(frozen=True)
class Flight:
    """Noisy frames (FRAMES, VEHICLES, ...) of vehicles that circle and turn about every axis, each its own way."""

    stamp_s: Array
    position_w_m: Array
    q_w_flu_wxyz: Array
    fresh: NDArray[np.bool_]

    def seen_by(self, vehicle: int) -> list[EstimatorState]:
        """The flying estimator's states, one for each frame; a frame that is missing never comes to it."""
        state, states = EstimatorState(), []
        for k in range(FRAMES):
            if self.fresh[k, vehicle]:
                stamp_s = float(self.stamp_s[k, vehicle])
                rotation = matrix_from_quat(self.q_w_flu_wxyz[k, vehicle])
                frame = MocapFrame(
                    frame=k,
                    stamp_s=stamp_s,
                    received_s=stamp_s,
                    position_w_m=self.position_w_m[k, vehicle],
                    rotation_w_b=rotation,
                    residual_m=0.0,
                )
                state = estimator.step(state, frame, PARAMS)
            states.append(state)
        return states

    def seen_together(self, one_stamp: bool) -> list[BatchEstimate]:
        """The batch's estimates after each frame; numbers of missing ones are NaN, signs of quaternions alternate."""
        estimate = batch.begin(self.position_w_m[0], self.q_w_flu_wxyz[0], self._stamp_s(0, one_stamp), PARAMS)
        estimates = [estimate]
        for k in range(1, FRAMES):
            known = np.where(self.fresh[k], 1.0, np.nan)[:, None]
            position, q = self.position_w_m[k] * known, self.q_w_flu_wxyz[k] * known * (-1.0) ** k
            estimate = batch.step(estimate, position, q, self._stamp_s(k, one_stamp), self.fresh[k], PARAMS)
            estimates.append(estimate)
        return estimates

    def _stamp_s(self, k: int, one_stamp: bool) -> float | Array:
        return float(self.stamp_s[k, 0]) if one_stamp else self.stamp_s[k]


def flight(seed: int, gaps: bool, spread_s: float = 0.0) -> Flight:
    """Frames every 10 ms, `spread_s` apart between vehicles; `gaps` of up to nine frames: 100 ms without one."""
    rng = np.random.default_rng(seed)
    stamp = PERIOD_S * np.arange(FRAMES)[:, None] + spread_s * rng.uniform(size=(FRAMES, VEHICLES))
    phase = rng.uniform(-np.pi, np.pi, size=(VEHICLES, 3)) + stamp[..., None] * rng.uniform(2.0, 5.0, (VEHICLES, 3))
    turned = quat_from_rotation_vector(np.array([0.3, 0.3, 2.5]) * np.sin(phase[..., ::-1]))
    noise = quat_from_rotation_vector(PARAMS.noise_rad * rng.normal(size=phase.shape))
    position = 0.4 * np.cos(phase) + PARAMS.noise_m * rng.normal(size=phase.shape)
    return Flight(stamp, position, quat_multiply(turned, noise), missing(rng) if gaps else np.ones(stamp.shape, bool))


def missing(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw which frames arrive; the first always does, and never ten in a row are lost."""
    fresh = np.ones((FRAMES, VEHICLES), dtype=bool)
    for vehicle in range(VEHICLES):
        k = int(rng.integers(1, 20))
        while k < FRAMES:
            lost = int(rng.integers(1, 10))
            fresh[k : k + lost, vehicle] = False
            k += lost + int(rng.integers(1, 20))
    return fresh


def relative_error(ours: Array, theirs: Array) -> float:
    """Return the relative difference of vectors, by their length."""
    return float(np.linalg.norm(ours - theirs) / max(float(np.linalg.norm(theirs)), 1e-3))


@pytest.mark.parametrize(("gaps", "spread_s"), [(False, 0.0), (True, 0.0), (False, 0.005), (True, 0.005)], ids=str)
def test_a_batch_is_the_flying_estimator_vehicle_by_vehicle(gaps: bool, spread_s: float) -> None:
    flown = flight(3, gaps, spread_s)
    together = flown.seen_together(one_stamp=spread_s == 0.0)
    worst = 0.0
    for vehicle in range(VEHICLES):
        alone = flown.seen_by(vehicle)
        assert alone[-1].counts.accepted + alone[-1].counts.started == flown.fresh[:, vehicle].sum(), "all believed"
        for one, all_of_them in zip(alone, together, strict=True):
            assert one.vehicle is not None
            state = batch.vehicle_state(all_of_them)
            assert np.broadcast_to(state.time_s, VEHICLES)[vehicle] == one.stamp_s
            worst = max(
                worst,
                relative_error(state.position_w_m[vehicle], one.vehicle.position_w_m),
                relative_error(state.velocity_w_mps[vehicle], one.vehicle.velocity_w_mps),
                relative_error(state.q_w_flu_wxyz[vehicle], one.vehicle.q_w_flu_wxyz),
                relative_error(state.rate_flu_radps[vehicle], one.vehicle.rate_flu_radps),
            )
    assert worst < 1e-12


def test_vehicles_that_saw_the_same_frames_share_their_covariance() -> None:
    together = flight(5, gaps=False).seen_together(one_stamp=True)[-1]
    assert type(together.motion.covariance.pp) is float
    assert type(together.attitude.covariance.pp) is float
    apart = flight(5, gaps=True).seen_together(one_stamp=True)[-1]
    assert np.shape(apart.motion.covariance.pp) == (VEHICLES, 1)
    assert np.shape(apart.attitude.covariance.pp) == (VEHICLES,)


def test_the_first_correction_by_hand() -> None:
    """At rest at first; 10 ms later one vehicle is seen 1 mm ahead, the other turned to the left by 10 mrad."""
    estimate = batch.begin(np.zeros((2, 3)), quat_from_yaw(0.0), 5.0, PARAMS)
    seen = np.array([[0.001, 0.0, 0.0], [0.0, 0.0, 0.0]]), quat_from_yaw(np.array([0.0, 0.01]))
    state = batch.vehicle_state(batch.step(estimate, *seen, 5.01, np.array([True, True]), PARAMS))
    # P of the position's error: 0.3 mm squared, 1 m/s and 5 m/s^2 over 10 ms, and the jerk's share (4 m^2/s^5)
    pp, pv = 9e-8 + 1e-4 + 6.25e-8 + 2e-11, 1e-2 + 1.25e-5 + 5e-9
    assert state.position_w_m[0, 0] == pytest.approx(0.001 * pp / (pp + 9e-8), rel=1e-12)
    assert state.velocity_w_mps[0, 0] == pytest.approx(0.001 * pv / (pp + 9e-8), rel=1e-12)
    # of the angle's: 2 mrad squared, 1 rad/s and 10 rad/s^2, 80 rad^2/s^5
    pp, pv = 4e-6 + 1e-4 + 2.5e-7 + 4e-10, 1e-2 + 5e-5 + 1e-7
    assert yaw_of(state.q_w_flu_wxyz)[1] == pytest.approx(0.01 * pp / (pp + 4e-6), rel=1e-12)
    assert state.rate_flu_radps[1, 2] == pytest.approx(0.01 * pv / (pp + 4e-6), rel=1e-12)
    np.testing.assert_array_equal(state.velocity_w_mps[1], 0.0)
    np.testing.assert_array_equal(state.rate_flu_radps[0], 0.0)


def test_it_begins_at_rest_where_it_was_seen() -> None:
    state = batch.vehicle_state(batch.begin(np.ones((4, 3)), -quat_from_yaw(0.5), 7.0, PARAMS))
    assert state.time_s == 7.0
    np.testing.assert_array_equal(state.position_w_m, np.ones((4, 3)))
    np.testing.assert_allclose(state.q_w_flu_wxyz, np.broadcast_to(quat_from_yaw(0.5), (4, 4)), atol=1e-15)
    np.testing.assert_array_equal(state.velocity_w_mps, np.zeros((4, 3)))
    np.testing.assert_array_equal(state.rate_flu_radps, np.zeros((4, 3)))


SEEN_BY_ALL = flight(7, gaps=False)


def seen_at(k: int) -> tuple[Array, Array]:
    return SEEN_BY_ALL.position_w_m[k], SEEN_BY_ALL.q_w_flu_wxyz[k]


def rows(estimate: BatchEstimate) -> Array:
    """All numbers of the state, a row for each vehicle."""
    state = batch.vehicle_state(estimate)
    vectors = (state.position_w_m, state.velocity_w_mps, state.q_w_flu_wxyz, state.rate_flu_radps)
    time_s = np.broadcast_to(state.time_s, state.position_w_m.shape[:-1])
    return np.concatenate((*vectors, time_s[..., None]), axis=-1).reshape(-1, 14)


@given(masks=st.lists(st.lists(st.booleans(), min_size=VEHICLES, max_size=VEHICLES), min_size=1, max_size=6))
def test_what_is_not_fresh_stays_and_the_rest_does_not_notice(masks: list[list[bool]]) -> None:
    estimate = batch.begin(*seen_at(0), 0.0, PARAMS)
    for k, fresh in enumerate(map(np.array, masks), start=1):
        before = estimate
        everyone = batch.step(before, *seen_at(k), k * PERIOD_S, np.ones(VEHICLES, dtype=bool), PARAMS)
        estimate = batch.step(before, *seen_at(k), k * PERIOD_S, fresh, PARAMS)
        np.testing.assert_array_equal(rows(estimate)[~fresh], rows(before)[~fresh])
        np.testing.assert_array_equal(rows(estimate)[fresh], rows(everyone)[fresh])


@pytest.mark.parametrize("lead", [(6,), (2, 3), (3, 1, 2)])
def test_leading_axes_are_only_a_way_to_count(lead: tuple[int, ...]) -> None:
    """Each vehicle of a batch of any shape is as if alone, without any leading axis."""

    def shaped(k: int) -> tuple[Array, Array]:
        position, q = seen_at(k)
        return position.reshape(*lead, 3), q.reshape(*lead, 4)

    def of_one(k: int, vehicle: int) -> tuple[Array, Array]:
        position, q = seen_at(k)
        return position[vehicle], q[vehicle]

    together = batch.begin(*shaped(0), 0.0, PARAMS)
    alone = [batch.begin(*of_one(0, i), 0.0, PARAMS) for i in range(VEHICLES)]
    for k in range(1, 50):
        fresh = np.array([(k * (i + 2)) % 5 > 0 for i in range(VEHICLES)])
        together = batch.step(together, *shaped(k), k * PERIOD_S, fresh.reshape(lead), PARAMS)
        for i in range(VEHICLES):
            alone[i] = batch.step(alone[i], *of_one(k, i), k * PERIOD_S, np.array(fresh[i]), PARAMS)
    assert batch.vehicle_state(together).rate_flu_radps.shape == (*lead, 3)
    np.testing.assert_allclose(rows(together), np.concatenate([rows(one) for one in alone]), rtol=1e-12, atol=1e-13)
