"""The messages that know a place on earth; None where the vehicle knows none."""

import math

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.messages import Message, boot_ms, boot_us, filled
from mock_autopilot.physics.geodesy import simulators_home
from mock_autopilot.world import World

GLOBAL_FIRST_S = 2.5
"""A GPS vehicle reports its global position from here on."""


def global_position_int(world: World) -> Message | None:
    """Only with a place on earth."""
    if not _knows_earth(world):
        return None
    now = world.vehicle.estimate
    lat, lon, alt_mm = world.vehicle.origin.to_global(now.position_m)
    home_z = world.vehicle.home.z_m if world.vehicle.home else 0.0
    relative_mm = round((home_z - now.position_m[2]) * 1e3)
    speeds = [round(v * 100) for v in now.velocity_mps]
    heading = round(math.degrees(now.yaw_rad) % 360.0 * 100) % 36000
    place = (lat, lon, alt_mm, relative_mm)
    return mavlink.MAVLink_global_position_int_message(boot_ms(world), *place, *speeds, heading)


def _knows_earth(world: World) -> bool:
    estimator = world.vehicle.estimator
    if estimator.uses_gps:
        return world.uptime_s >= GLOBAL_FIRST_S
    return estimator.origin_set_s is not None


def gps_raw_int(world: World) -> Message:
    """The receiver; PX4 reports it fused or not."""
    state = world.vehicle.sensor_state.motion
    lat, lon, alt_mm = simulators_home(world.vehicle.params).to_global(state.position_ned_m)
    vn, ve, _ = state.velocity_ned_mps
    return filled(
        mavlink.MAVLink_gps_raw_int_message,
        time_usec=boot_us(world),
        fix_type=3,
        lat=lat,
        lon=lon,
        alt=alt_mm,
        eph=70,
        epv=110,
        vel=round(math.hypot(vn, ve) * 100),
        cog=round(math.degrees(math.atan2(ve, vn)) % 360.0 * 100) % 36000,
        satellites_visible=10,
        alt_ellipsoid=alt_mm,
        h_acc=900,
        v_acc=1780,
        vel_acc=400,
    )


def gps_global_origin(world: World) -> Message | None:
    """Build GPS_GLOBAL_ORIGIN: the local frame's origin on earth."""
    if not world.vehicle.estimator.uses_gps and world.vehicle.estimator.origin_set_s is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(*world.vehicle.origin.to_global((0.0, 0.0, 0.0)), boot_us(world))


def hil_state_quaternion(world: World) -> Message:
    """The simulator's truth; a simulated PX4 has it, one on a vehicle has nothing to send."""
    truth = world.truth
    place = simulators_home(world.vehicle.params).to_global(world.vehicle.sensor_state.motion.position_ned_m)
    speeds = [round(100 * v) for v in truth.velocity_ned_mps.tolist()]
    q, rates, unused = truth.q_ned_frd_wxyz.tolist(), truth.rate_frd_radps.tolist(), [0] * 5
    return mavlink.MAVLink_hil_state_quaternion_message(boot_us(world), q, *rates, *place, *speeds, *unused)


def home_position(world: World) -> Message | None:
    """Build HOME_POSITION, the destination of Return mode."""
    home = world.vehicle.home
    if home is None:
        return None
    place = (home.x_m, home.y_m, home.z_m)
    return mavlink.MAVLink_home_position_message(
        *world.vehicle.origin.to_global(place), *place, [1.0, 0.0, 0.0, 0.0], *[0.0] * 3, boot_us(world)
    )
