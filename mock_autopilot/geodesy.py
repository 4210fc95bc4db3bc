"""Where on earth the local frame lies: the simulator's home near Zurich (SIH_LOC_*), flat-earth."""

import math

from mock_autopilot.params import ParamTable

EARTH_RADIUS_M = 6371000.0


def to_global(params: ParamTable, position_ned_m: tuple[float, float, float]) -> tuple[int, int, int]:
    """Latitude and longitude (1e-7 degrees) and altitude (mm) of a local position."""
    north_m, east_m, down_m = position_ned_m
    lat0 = params["SIH_LOC_LAT0"]
    lat = lat0 + math.degrees(north_m / EARTH_RADIUS_M)
    lon = params["SIH_LOC_LON0"] + math.degrees(east_m / (EARTH_RADIUS_M * math.cos(math.radians(lat0))))
    return round(lat * 1e7), round(lon * 1e7), round((params["SIH_LOC_H0"] - down_m) * 1e3)
