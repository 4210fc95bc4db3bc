"""Fly the same path with two control laws and print the errors from the flight's record; docs/python.md.

    python examples/compare_laws.py [FOLDER_OF_RECORDS [PATH]]

PATH is ellipse, figure8 or a CSV file of waypoints. The service writes the record: run this on its computer.
"""

import sys
from pathlib import Path

from companion.analysis.report.numbers import AXES, numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.client import Curve
from companion.client.sync import connect
from companion.records.read import read_flight

LAWS = ("etnn", "pid")


def fly(path: Curve | str) -> None:
    """Fly the path with each law, in one flight."""
    with connect() as vehicle:
        vehicle.arm()
        vehicle.takeoff(height_m=0.4)
        for law in LAWS:
            if vehicle.state.controller != law:
                vehicle.controller(law)
            print(vehicle.track(path))
        vehicle.land()


def show(path: Path) -> None:
    """Print the mean absolute error of each trajectory in a record."""
    print(f"{path}: mean error in cm ({', '.join(AXES)}, norm)")
    for one in numbers_of(Flown(read_flight(path))).trajectories:
        assert one.errors is not None
        print(f"{one.name} with {one.law}:", *(f"{100.0 * error_m:.1f}" for error_m in one.errors.mean_m))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "flights")
    fly(sys.argv[2] if len(sys.argv) > 2 else Curve("ellipse", laps=1, size=0.5))
    show(max(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime))
