"""Coming to rest along the path that was planned: what was checked for collisions and limits stays checked."""

from dataclasses import dataclass

import numpy as np

from companion.arms.trajectory import JointTrajectory, Times
from companion.core.types import Array, JointMotion


@dataclass(frozen=True)
class Braked:
    """A trajectory whose own time slows down, from `begun_s` on, and stands still after `duration_s`."""

    inner: JointTrajectory
    begun_s: float
    duration_s: float

    @property
    def pieces_s(self) -> Array:
        """Eighths."""
        return np.linspace(0.0, self.duration_s, 9)

    def at(self, time_s: Times) -> JointMotion:
        """The motion `time_s` after the braking began."""
        x = np.clip(np.asarray(time_s) / self.duration_s, 0.0, 1.0)
        gone_s = self.duration_s * x * (1.0 - x**3 * (2.5 - 3.0 * x + x * x))
        speed = (1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x * x))[..., None]
        slowing_ps = (-30.0 * x * x * (1.0 - x) ** 2 / self.duration_s)[..., None]
        motion = self.inner.at(self.begun_s + gone_s)
        return JointMotion(
            motion.position_rad,
            motion.velocity_radps * speed,
            motion.acceleration_radps2 * speed * speed + motion.velocity_radps * slowing_ps,
        )
