"""A first flight: take off, fly to two places, land. It needs a running service: docs/python.md."""

from companion.client.sync import connect

with connect() as vehicle:
    vehicle.arm()
    vehicle.takeoff(height_m=0.4)
    for place_w_m in [(0.3, 0.0, 0.5), (0.0, 0.0, 0.4)]:
        vehicle.goto(place_w_m)
        print("at", vehicle.position_w_m.round(2), "m, battery", vehicle.state.battery)
    vehicle.land()
