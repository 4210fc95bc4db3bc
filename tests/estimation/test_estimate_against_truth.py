"""The simulated cameras' bytes, read and estimated, against the truth they were taken of."""

import numpy as np
from qtm_rt.packet import QRTPacket

from companion.adapters.qualisys.bodies import RigidBody
from companion.adapters.qualisys.source import QualisysSource
from companion.core.types import Array, VehicleState
from companion.estimation.estimator import EstimatorParams, EstimatorState, step
from companion.geometry.frames import flip_quat, flip_yz, matrix_from_quat
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import Component, data_packet

RADIUS_M, TURN_RADPS = 1.0, 1.2
LEAST_DELAY_S = 0.010
"""8 ms, then anything up to 4 ms more, then the next truth, of which there is one every 2 ms."""
BOOTED_S = 50.0
"""Our clock when the truth's was zero."""


class FollowingClock:
    """`interfaces.Clock` that shows the truth's time on our clock."""

    time_s = 0.0

    def now_s(self) -> float:
        return BOOTED_S + self.time_s


def circling(time_s: float) -> Truth:
    """A circle, clockwise seen from above, banked to the inside (right) by 0.2 rad, nose along the path."""
    angle = TURN_RADPS * time_s
    position = np.array([RADIUS_M * np.sin(angle), -RADIUS_M * np.cos(angle), -1.5])
    velocity = RADIUS_M * TURN_RADPS * np.array([np.cos(angle), np.sin(angle), 0.0])
    q = quat.from_euler(0.2, 0.0, angle)
    rate = in_body_axes(q, np.array([0.0, 0.0, TURN_RADPS]))
    return Truth(time_s, position, velocity, q, rate, on_ground=False)


def in_body_axes(q: Array, vector_world: Array) -> Array:
    """A world vector in body axes."""
    return np.asarray(quat.to_matrix(q).T @ vector_world)


def estimates(for_s: float) -> list[tuple[Truth, VehicleState]]:
    """Return the estimate whenever a frame arrives, with the truth at that very instant (not at the capture)."""
    clock = FollowingClock()
    source = QualisysSource("dauam", "test", clock)
    source.take_bodies((RigidBody("dauam"),))
    camera = Camera(QualisysConfig(jitter_s=0.004, drop_probability=0.02), seed=3)
    params, state = EstimatorParams(delay_s=LEAST_DELAY_S), EstimatorState()
    known = []
    for k in range(round(for_s / 0.002)):
        truth = circling(0.002 * k)
        clock.time_s = truth.time_s
        for frame in camera.look(truth):
            source.on_packet(QRTPacket(data_packet(frame, [Component.SIX_D_RES])[8:]))
            latest = source.latest()
            assert latest is not None
            state = step(state, latest, params)
            assert state.vehicle is not None
            known.append((truth, state.vehicle))
    return known


KNOWN = estimates(10.0)[100:]


def test_the_state_is_right_at_its_capture() -> None:
    for _, vehicle in KNOWN:
        truth = circling(vehicle.time_s - BOOTED_S)
        np.testing.assert_allclose(vehicle.position_w_m, flip_yz(truth.position_ned_m), atol=0.004)
        np.testing.assert_allclose(vehicle.velocity_w_mps, flip_yz(truth.velocity_ned_mps), atol=0.05)
        expected = matrix_from_quat(flip_quat(truth.q_ned_frd_wxyz))
        np.testing.assert_allclose(matrix_from_quat(vehicle.q_w_flu_wxyz), expected, atol=0.012)


def test_velocity_and_rate_are_right_on_average() -> None:
    velocity_errors, rate_errors = [], []
    for _, vehicle in KNOWN:
        truth = circling(vehicle.time_s - BOOTED_S)
        velocity_errors.append(vehicle.velocity_w_mps - flip_yz(truth.velocity_ned_mps))
        rate_errors.append(vehicle.rate_flu_radps - flip_yz(truth.rate_frd_radps))
    assert np.std(velocity_errors) < 0.012
    assert np.std(rate_errors) < 0.07
    np.testing.assert_allclose(np.mean(rate_errors, axis=0), 0.0, atol=0.02)
