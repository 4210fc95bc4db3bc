"""The simulated cameras' times of capture, measurements and delays, all in simulated time."""

from typing import Any

import numpy as np
import pytest

from mock_autopilot.physics.quaternion import from_euler
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.qtm.config import Interval, QualisysConfig
from mock_autopilot.qtm.packets import Component, Frame, data_packet
from tests.mock_autopilot.qtm.truths import flight, truth_at

RIGHT = np.array([0.0, 0.0, 2.0])
QUIET: dict[str, Any] = {"noise_m": 0.0, "noise_rad": 0.0, "delay_s": 0.0}


def seen(for_s: float = 1.0, seed: int = 1, **settings: Any) -> list[Frame]:
    camera = Camera(QualisysConfig(**settings), seed)
    return [frame for truth in flight(for_s) for frame in camera.look(truth)]


def as_bytes(frames: list[Frame]) -> list[bytes]:
    return [data_packet(frame, [Component.SIX_D_RES]) for frame in frames]


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 300.0])
def test_frames_come_at_the_rate_in_the_truths_time(rate_hz: float) -> None:
    frames = seen(rate_hz=rate_hz, delay_s=0.0)
    assert [frame.stamp_us for frame in frames] == [round(n * 1e6 / rate_hz) for n in range(len(frames))]
    assert len(frames) == pytest.approx(rate_hz, abs=1)


def test_a_capture_between_two_truths_is_at_its_own_place() -> None:
    for frame in seen(rate_hz=300.0, **QUIET):
        assert frame.bodies[0].position_room_m[0] == pytest.approx(frame.stamp_us * 1e-6, abs=1e-6)


def test_a_capture_between_two_truths_has_its_own_attitude() -> None:
    """Turning to the right at 2 rad/s: at the capture the heading is 2 rad/s times the capture's time."""
    camera = Camera(QualisysConfig(rate_hz=300.0, **QUIET), 1)
    for k in range(100):
        time_s = 0.002 * k
        truth = truth_at(time_s, q_ned_frd_wxyz=from_euler(0.0, 0.0, 2.0 * time_s))._replace(rate_frd_radps=RIGHT)
        for frame in camera.look(truth):
            nose = frame.bodies[0].rotation_room_flu[:, 0]
            assert np.arctan2(-nose[1], nose[0]) == pytest.approx(2.0 * frame.stamp_us * 1e-6, abs=1e-5)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    assert as_bytes(seen(seed=7, drop_probability=0.1)) == as_bytes(seen(seed=7, drop_probability=0.1))
    assert as_bytes(seen(seed=7)) != as_bytes(seen(seed=8))


def test_a_frame_leaves_after_its_delay() -> None:
    camera = Camera(QualisysConfig(delay_s=0.008), 1)
    left_s = [truth.time_s for truth in flight(0.1) for _ in camera.look(truth)]
    assert left_s == pytest.approx([0.008 + 0.01 * n for n in range(len(left_s))])


def test_jitter_delays_but_never_reorders() -> None:
    frames = seen(for_s=2.0, jitter_s=0.030)
    numbers = [frame.number for frame in frames]
    assert numbers == sorted(numbers)
    assert len(numbers) > 190


def test_dropped_frames_leave_gaps_in_the_numbers() -> None:
    numbers = [frame.number for frame in seen(for_s=10.0, drop_probability=0.2)]
    assert 700 < len(numbers) < 900, "about 800 of 1000 are left"
    assert len(set(numbers)) == len(numbers)


def test_in_an_outage_frames_come_without_the_body_but_with_the_others() -> None:
    frames = seen(outages=(Interval(start_s=0.2, for_s=0.3),), extra_bodies=("leader",))
    lost = [frame.number for frame in frames if np.isnan(frame.bodies[0].position_room_m).all()]
    assert lost == list(range(20, 50))
    assert all(np.isfinite(frame.bodies[1].position_room_m).all() for frame in frames)


def test_in_a_silence_no_frames_come() -> None:
    numbers = [frame.number for frame in seen(silences=(Interval(start_s=0.2, for_s=0.3),))]
    assert [n for n in numbers if 20 <= n < 50] == []
    assert {19, 50} <= set(numbers)


def test_a_fault_does_not_change_the_noise_of_the_other_frames() -> None:
    whole = seen()
    without = dict(zip((frame.number for frame in whole), as_bytes(whole), strict=True))
    gap = seen(silences=(Interval(start_s=0.2, for_s=0.1),))
    assert all(without[frame.number] == data for frame, data in zip(gap, as_bytes(gap), strict=True))


def test_the_noise_is_as_large_as_configured() -> None:
    frames = seen(for_s=20.0, noise_m=0.0003, noise_rad=0.002, delay_s=0.0)
    heights = np.array([frame.bodies[0].position_room_m[2] for frame in frames])
    tilts = np.array([frame.bodies[0].rotation_room_flu[2, 1] for frame in frames])
    assert heights.std() == pytest.approx(0.0003, rel=0.1)
    assert tilts.std() == pytest.approx(0.002, rel=0.1)


def test_the_room_has_z_up_and_x_north() -> None:
    camera = Camera(QualisysConfig(**QUIET), 1)
    (frame,) = camera.look(truth_at(0.0, position_ned_m=(1.0, 2.0, -3.0)))
    assert frame.bodies[0].position_room_m.tolist() == [1.0, -2.0, 3.0], "north 1, east 2, up 3: west is y"
    assert frame.bodies[0].rotation_room_flu.tolist() == np.eye(3).tolist()
