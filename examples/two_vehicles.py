"""Fly two vehicles at the same time, each a ring beside the place where it hovers; docs/several-vehicles.md.

python examples/two_vehicles.py [NAME NAME]

Without names: all that are online on the broker.
"""

import asyncio
import sys

import numpy as np
from numpy.typing import NDArray

from companion.client import Vehicle, connect_all, together

HEIGHT_M, RADIUS_M, DURATION_S = 0.5, 0.15, 4.0


def ring(vehicle: Vehicle) -> NDArray[np.float64]:
    """Return rows of t_s, x_m, y_m, z_m of a ring that begins and ends at rest where the vehicle is."""
    x_m, y_m, _ = vehicle.position_w_m
    t_s = np.linspace(0.0, DURATION_S, 41)
    angle = 2.0 * np.pi * t_s / DURATION_S - np.sin(2.0 * np.pi * t_s / DURATION_S)
    height_m = np.full_like(t_s, HEIGHT_M)
    return np.column_stack((t_s, x_m + RADIUS_M * (np.cos(angle) - 1.0), y_m + RADIUS_M * np.sin(angle), height_m))


async def watch(left: Vehicle, right: Vehicle, distances_m: list[float]) -> None:
    """Note the horizontal distance ten times a second."""
    async for _ in left.states():
        distances_m.append(float(np.linalg.norm((left.position_w_m - right.position_w_m)[:2])))


async def main(*names: str) -> None:
    """Take off, fly and land, both at the same time; an error in any of it lands both."""
    distances_m: list[float] = []
    async with connect_all(*names) as vehicles:
        left, right = vehicles
        watching = asyncio.create_task(watch(left, right, distances_m))
        try:
            await together(left.arm(), right.arm())
            await together(left.takeoff(HEIGHT_M), right.takeoff(HEIGHT_M))
            for said in await together(left.track(ring(left)), right.track(ring(right))):
                print(said)
            print(*await together(left.land(), right.land()), sep="\n")
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
    print(f"{left.name} and {right.name} were never nearer than {min(distances_m):.2f} m")


if __name__ == "__main__":
    asyncio.run(main(*(sys.argv[1:] or ["all"])))
