"""The compiled servos move as those in Python, to the last bit, and leave to them what they cannot."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from companion.compiled.library import library
from companion.simulation import compiled_arms
from companion.simulation.compiled_arms import driven
from mock_autopilot.config import ArmsConfig, MockConfig
from mock_autopilot.physics.arm_table import Drive, angles_of, table_of

ARMS = MockConfig.load(Path(__file__).parents[2] / "config" / "mock.toml").arms
TIME_S = np.arange(60)[:, None] * 0.01
SWING = np.array([0.4, -0.5, 0.3, 0.2, 0.3, -0.6, 0.2, 0.1])


def drive(swing: Callable[[np.ndarray], np.ndarray]) -> Drive:
    """Return the drive that `table_of` asks for: all joints differently, from the stowed pose on."""
    asked: list[Drive] = []

    def remember(one: Drive) -> np.ndarray:
        asked.append(one)
        return np.tile(one.goals_rad[:1], (one.count + 1, 1))

    table_of(ARMS, _stowed(ARMS) + SWING * swing(TIME_S), 0.01, 0.005, remember)
    return asked[0]


def _stowed(arms: ArmsConfig) -> np.ndarray:
    return np.array([servo.start_position_rad or 0.0 for servo in arms.bus.servos]) - arms.zero_rad


@pytest.mark.skipif(library() is None, reason="without a C compiler there is nothing compiled")
@pytest.mark.parametrize("swing", [lambda t: 1.0 - np.cos(t / 0.06), lambda t: np.sign(np.sin(t / 0.03))])
def test_servos_move_the_same_to_the_last_bit(
    swing: Callable[[np.ndarray], np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = drive(swing)
    reference = angles_of(drive(swing))
    monkeypatch.setattr(compiled_arms, "angles_of", lambda _: pytest.fail("it is to be compiled code that drives"))
    angles = driven(one)
    assert np.abs(angles - angles[0]).max() > 0.1
    np.testing.assert_array_equal(angles, reference)


def test_a_profile_that_limits_the_speed_is_left_to_python() -> None:
    one, same = (drive(np.sin) for _ in range(2))
    for each in (one, same):
        each.motors[0].profile_limit_radps = 0.5
    limited, reference = driven(one), angles_of(same)
    np.testing.assert_array_equal(limited, reference)
    assert limited[-1, 0] != angles_of(drive(np.sin))[-1, 0]
