"""Flat-earth conversion between the local frame and latitude, longitude and altitude."""

import math
from dataclasses import dataclass

from mock_autopilot.px4.params import ParamTable

EARTH_RADIUS_M = 6371000.0


@dataclass(frozen=True)
class Origin:
    """Place on earth of the local frame's origin."""

    latitude_deg: float
    longitude_deg: float
    above_sea_m: float

    def to_global(self, position_ned_m: tuple[float, float, float]) -> tuple[int, int, int]:
        """Return latitude and longitude (1e-7 degrees) and altitude (mm) of a local position."""
        north_m, east_m, down_m = position_ned_m
        lat = self.latitude_deg + math.degrees(north_m / EARTH_RADIUS_M)
        lon = self.longitude_deg + math.degrees(east_m / (EARTH_RADIUS_M * math.cos(math.radians(self.latitude_deg))))
        return round(lat * 1e7), round(lon * 1e7), round((self.above_sea_m - down_m) * 1e3)


def simulators_home(params: ParamTable) -> Origin:
    """Return the recorded simulator's home near Zurich (SIH_LOC_*), where its GPS receiver puts it."""
    return Origin(params["SIH_LOC_LAT0"], params["SIH_LOC_LON0"], params["SIH_LOC_H0"])
