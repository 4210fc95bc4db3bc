"""Fly a curve of one's own, a NumPy array, and measure the error meanwhile; docs/python.md.

python examples/own_curve.py [DURATION_S]
"""

import asyncio
import contextlib
import sys

import numpy as np
from numpy.typing import NDArray

from companion.client import Progress, Vehicle, connect

HEIGHT_M, RADIUS_M = 0.5, 0.3


def leaning_ring(duration_s: float) -> NDArray[np.float64]:
    """Return a ring that leans to one side as rows of t_s, x_m, y_m, z_m; it begins and ends at rest."""
    t_s = np.linspace(0.0, duration_s, 61)
    share = t_s / duration_s
    angle = 2.0 * np.pi * share - np.sin(2.0 * np.pi * share)
    x_m, y_m = RADIUS_M * (1.0 - np.cos(angle)), RADIUS_M * np.sin(angle)
    return np.column_stack((t_s, x_m, y_m, HEIGHT_M + 0.3 * x_m))


async def measure(vehicle: Vehicle, errors_m: list[float]) -> None:
    """Note the error ten times a second while the curve is flown."""
    async for state in vehicle.states():
        if state.phase == "track" and state.error_m is not None:
            errors_m.append(state.error_m)


def show(step: Progress) -> None:
    """Print the height while a command is under way."""
    print(f"\r{step.verb} {step.elapsed_s:4.1f} s, {step.state.phase}", end="", flush=True)


async def main(duration_s: float) -> None:
    """Take off, fly the curve, land."""
    errors_m: list[float] = []
    async with connect() as vehicle:
        vehicle.progress = show
        measuring = asyncio.create_task(measure(vehicle, errors_m))
        try:
            await vehicle.arm()
            await vehicle.takeoff(HEIGHT_M)
            print("\r" + await vehicle.track(leaning_ring(duration_s)))
            await vehicle.land()
        finally:
            measuring.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await measuring
    print(f"\rerror: mean {100.0 * np.mean(errors_m):.1f} cm, largest {100.0 * np.max(errors_m):.1f} cm")


if __name__ == "__main__":
    asyncio.run(main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0))
