"""A point mass whose acceleration is the command, at once or after a first-order lag; no noise, no delay."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.control.controller import ControlInput
from companion.control.etnn import Etnn
from companion.control.gains import EtnnGains
from companion.core.types import Array
from companion.trajectories.reference import Trajectory

TOO_FAR_M = 2.0


@dataclass(frozen=True)
class Run:
    """Signals of the law per step (n, ...), with weights v0 and v1, p_d' (n, 3) as `velocity_ref` and `event` (n, 1);
    the time at which it went beyond `too_far_m`, or None."""

    signals: dict[str, Array]
    left_at_s: float | None

    @property
    def error_m(self) -> Array:
        return self.signals["x1"]


def no_friction(velocity_w_mps: Array) -> Array:
    return np.zeros_like(velocity_w_mps)


def simulate(
    gains: EtnnGains,
    trajectory: Trajectory,
    for_s: float,
    *,
    dt_s: float = 0.001,
    lag_s: float = 0.0,
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    friction: Callable[[Array], Array] = no_friction,
    too_far_m: float = TOO_FAR_M,
) -> Run:
    """Fly from rest, offset from the trajectory's start; `friction` is f of eq. mod (m/s^2, of a velocity in m/s)."""
    law = Etnn(gains)
    p, v = trajectory.at(0.0).position_w_m + np.array(offset_m), np.zeros(3)
    a, u, still = np.zeros(3), np.zeros(3), np.zeros(3)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    follow = 1.0 if lag_s == 0.0 else 1.0 - float(np.exp(-dt_s / lag_s))
    memory, left_at = None, None
    rows: list[dict[str, Array]] = []
    for n in range(round(for_s / dt_s)):
        now = ControlInput(
            position_w_m=p,
            velocity_w_mps=v,
            q_w_flu_wxyz=level,
            rate_flu_radps=still,
            age_s=0.0,
            reference=trajectory.at(n * dt_s),
            sent_accel_w_mps2=u,
            dt_s=dt_s,
        )
        memory = law.initial(now) if memory is None else memory
        weights = memory.network
        memory, out = law.step(memory, now)
        u, extra = out.accel_w_mps2, {"v0": weights.v0, "v1": weights.v1, "event": out.event}
        rows.append(out.signals | extra | {"velocity_ref": now.reference.velocity_w_mps})
        if float(np.linalg.norm(out.signals["x1"])) > too_far_m:
            left_at = n * dt_s
            break
        a = a + follow * (u - a)
        moving = a + friction(v)
        p, v = p + dt_s * v + 0.5 * dt_s**2 * moving, v + dt_s * moving
    return Run({name: np.array([row[name] for row in rows]) for name in rows[0]}, left_at)
