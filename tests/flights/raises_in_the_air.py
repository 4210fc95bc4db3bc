"""A script that raises in mid-air: `python -m tests.flights.raises_in_the_air`."""

from companion.client.sync import connect

with connect() as vehicle:
    vehicle.arm()
    vehicle.takeoff(height_m=0.4)
    raise ValueError(f"{vehicle.state.phase} at {vehicle.position_w_m[2]:.1f} m")
