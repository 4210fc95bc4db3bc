"""Every message the mock sends by itself, built from the world: one function per message.

Values that nothing here simulates (magnetometer, accuracies, AUTOPILOT_VERSION, ...) are those recorded from PX4 v1.17.
A builder returns None when there is nothing to send, as PX4 does without GPS or home.
"""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.plant import GRAVITY_MPS2
from mock_autopilot.px4.health import sensors_enabled, sensors_health, sensors_present
from mock_autopilot.px4.vocabulary import Mode
from mock_autopilot.world import World

Message = Any
"""A pymavlink message; pymavlink has no types."""
Builder = Callable[[World], Message | None]

NAN = math.nan
EST_POSITION = 8
"""ESTIMATOR_STATUS.flags: the horizontal position is trusted."""
CAPABILITIES = 59647
SW_VERSION = 0x011100FF
OS_VERSION = 101854463
CUSTOM_VERSION = [0, 0, 0, 196, 209, 42, 241, 214]
UID = 5283920058631409231
MAGNETIC_FIELD_GAUSS = (0.2015, 0.0326, 0.4609)


def boot_ms(world: World) -> int:
    """Return the time since boot, ms."""
    return round(world.uptime_s * 1e3)


def boot_us(world: World) -> int:
    """Return the time since boot, us."""
    return round(world.uptime_s * 1e6)


def filled(kind: Any, **fields: Any) -> Message:
    """Build a message of a pymavlink class; every number that is not named is zero."""
    return kind(**(dict.fromkeys(kind.fieldnames, 0) | fields))


def heartbeat(world: World) -> Message:
    """Build HEARTBEAT: mode, armed, system status."""
    vehicle = world.vehicle
    custom = vehicle.mode.custom_mode
    return mavlink.MAVLink_heartbeat_message(2, 12, vehicle.base_mode, custom, int(vehicle.system_status), 3)


def sys_status(world: World) -> Message:
    """Build SYS_STATUS: health bits and battery."""
    battery = world.vehicle.battery
    vehicle = world.vehicle
    return filled(
        mavlink.MAVLink_sys_status_message,
        onboard_control_sensors_present=sensors_present(vehicle),
        onboard_control_sensors_enabled=sensors_enabled(vehicle),
        onboard_control_sensors_health=sensors_health(vehicle),
        onboard_control_sensors_health_extended=1,
        load=173,
        voltage_battery=round(battery.voltage_v * 1e3),
        current_battery=-100,
        battery_remaining=battery.percent,
    )


def extended_sys_state(world: World) -> Message:
    """On ground, taking off, in air, landing."""
    return mavlink.MAVLink_extended_sys_state_message(0, int(world.vehicle.landed_state))


def attitude(world: World) -> Message | None:
    """Estimated Euler angles and body rates."""
    if world.uptime_s < 1.0:
        return None
    angles = quat.to_euler(world.vehicle.attitude_estimate_wxyz)
    return mavlink.MAVLink_attitude_message(boot_ms(world), *angles, *world.truth.rate_frd_radps.tolist())


def attitude_quaternion(world: World) -> Message | None:
    """Build ATTITUDE_QUATERNION: the estimated attitude, w x y z, and body rates."""
    if world.uptime_s < 1.0:
        return None
    p, q, r = world.truth.rate_frd_radps.tolist()
    return mavlink.MAVLink_attitude_quaternion_message(
        boot_ms(world), *world.vehicle.attitude_estimate_wxyz.tolist(), p, q, r
    )


def local_position_ned(world: World) -> Message:
    """The estimate; it streams on whether it is worth anything or not."""
    now = world.vehicle.estimate
    return mavlink.MAVLink_local_position_ned_message(boot_ms(world), *now.position_m, *now.velocity_mps)


def odometry(world: World) -> Message:
    """The estimate once more, with its reset counter."""
    now, estimator = world.vehicle.estimate, world.vehicle.estimator
    pose, velocity = [NAN] * 21, [NAN] * 21
    for index, variance in ((0, 0.04), (6, 0.04), (11, 0.07), (15, 2e-4), (18, 2e-4), (20, 2e-3)):
        pose[index] = variance
    for index in (0, 6, 11):
        velocity[index] = 0.008
    place = boot_us(world), 1, 1, *now.position_m, world.vehicle.attitude_estimate_wxyz.tolist()
    motion = *now.velocity_mps, *world.truth.rate_frd_radps.tolist()
    resets = estimator.reset_counter % 256
    return mavlink.MAVLink_odometry_message(
        *place, *motion, pose, velocity, reset_counter=resets, estimator_type=8, quality=0
    )


def attitude_target(world: World) -> Message:
    """The setpoint being followed, as PX4 repeats it."""
    target = world.vehicle.target
    rates = target.rate_frd_radps or (0.0, 0.0, 0.0)
    return mavlink.MAVLink_attitude_target_message(
        boot_ms(world), 0, list(target.echo_q_wxyz), *rates, target.echo_thrust
    )


def position_target_local_ned(world: World) -> Message | None:
    """Not in attitude offboard; otherwise almost empty."""
    if world.vehicle.mode is Mode.OFFBOARD:
        return None
    place, acceleration = [NAN] * 6, (0.0, 0.0, 100.0)
    yaw = world.vehicle.estimate.yaw_rad
    return mavlink.MAVLink_position_target_local_ned_message(
        boot_ms(world), 1, 63, *place, *acceleration, yaw=yaw, yaw_rate=0.0
    )


def rc_channels(_world: World) -> Message | None:
    """Granted, and never sent: there is no remote control."""
    return None


def servo_output_raw(world: World) -> Message:
    """All four motors alike: 900 off, 1000 to 2000 us."""
    signal = world.vehicle.signal
    finite = signal if math.isfinite(signal) else 0.0
    pulse = round(1000 + 1000 * min(max(finite, 0.0), 1.0)) if world.vehicle.armed else 900
    return mavlink.MAVLink_servo_output_raw_message(boot_us(world) % 2**32, 0, *[pulse] * 4, *[900] * 12)


def vfr_hud(world: World) -> Message:
    """Build VFR_HUD, the speeds, heading and throttle of a head-up display."""
    now = world.vehicle.estimate
    speed = math.hypot(*now.velocity_mps[:2])
    heading = round(math.degrees(now.yaw_rad)) % 360
    signal = world.vehicle.signal
    throttle = round(100 * min(max(signal, 0.0), 1.0)) if math.isfinite(signal) else 0
    altitude = world.vehicle.origin.to_global(now.position_m)[2] / 1e3
    return mavlink.MAVLink_vfr_hud_message(NAN, speed, heading, throttle, altitude, -now.velocity_mps[2])


def altitude_message(world: World) -> Message:
    """ALTITUDE: above sea, above home, in the local frame."""
    now = world.vehicle.estimate
    above_sea = world.vehicle.origin.to_global(now.position_m)[2] / 1e3
    home_z = world.vehicle.home.z_m if world.vehicle.home else 0.0
    up = -now.position_m[2]
    heights = (above_sea, above_sea, up, up + home_z)
    return mavlink.MAVLink_altitude_message(boot_us(world), *heights, altitude_terrain=NAN, bottom_clearance=NAN)


def highres_imu(world: World) -> Message:
    """Specific force (m/s^2) and rates (rad/s) in the body frame; zacc reads -9.8 at rest."""
    state = world.state
    ax, ay, az = state.acceleration_ned_mps2.tolist()
    force = quat.to_matrix(state.q_ned_frd_wxyz).T @ [ax, ay, az - GRAVITY_MPS2]
    height = world.vehicle.origin.to_global(world.vehicle.sensor_state.motion.position_ned_m)[2] / 1e3
    return mavlink.MAVLink_highres_imu_message(
        boot_us(world),
        *force.tolist(),
        *state.rate_frd_radps.tolist(),
        *MAGNETIC_FIELD_GAUSS,
        abs_pressure=955.8,
        diff_pressure=0.0,
        pressure_alt=height,
        temperature=15.0,
        fields_updated=63,
    )


def estimator_status(world: World) -> Message:
    """Build ESTIMATOR_STATUS: the trusted parts of the estimate, and their measurements' test ratios."""
    estimator, ratio = world.vehicle.estimator, world.timing.ratio
    flags = estimator.flags
    if estimator.uses_gps:
        ratios = (0.15, 0.04, 0.06, 0.08, 0.14)
    elif not flags & EST_POSITION:
        ratios = (NAN, NAN, ratio(0.03, 0.28), NAN, ratio(0.06, 0.77))
    elif estimator.in_air:
        ratios = (NAN, ratio(0.075, 0.774), ratio(0.025, 0.28), ratio(0.005, 0.02), ratio(0.06, 0.775))
    else:
        ratios = (NAN, ratio(0.004, 0.01), ratio(0.002, 0.005), ratio(0.001, 0.002), ratio(0.004, 0.01))
    if not estimator.uses_gps and not int(world.vehicle.params["EKF2_RNG_CTRL"]):
        ratios = (*ratios[:4], NAN)
    accuracy = (0.29, 0.27) if estimator.uses_gps else (0.032, 0.018)
    return mavlink.MAVLink_estimator_status_message(boot_us(world), flags, *ratios, NAN, *accuracy)


def battery_status(world: World) -> Message:
    """Build BATTERY_STATUS: cell voltage, charge, warning."""
    battery = world.vehicle.battery
    return filled(
        mavlink.MAVLink_battery_status_message,
        battery_function=1,
        type=1,
        temperature=32767,
        voltages=[round(battery.voltage_v * 1e3)] + [65535] * 9,
        current_battery=-100,
        current_consumed=-1,
        energy_consumed=-1,
        battery_remaining=battery.percent,
        charge_state=1 + battery.warning,
        voltages_ext=[0] * 4,
    )


def timesync(world: World) -> Message:
    """PX4 asks for the client's clock."""
    return mavlink.MAVLink_timesync_message(0, round(world.uptime_s * 1e9))


def ping(world: World) -> Message:
    """PX4 asks whether anybody is there; the sequence counts its seconds."""
    return mavlink.MAVLink_ping_message(boot_us(world), round(world.uptime_s), 0, 0)


def mission_current(_world: World) -> Message:
    """Build MISSION_CURRENT: there is no mission."""
    return mavlink.MAVLink_mission_current_message(0, 65535, 1, 2)


def vibration(world: World) -> Message:
    """Build VIBRATION with zero vibration."""
    return filled(mavlink.MAVLink_vibration_message, time_usec=boot_us(world))


def current_mode(world: World) -> Message:
    """The mode it flies and the mode the user wants."""
    commander = world.vehicle.commander
    return mavlink.MAVLink_current_mode_message(0, commander.mode.custom_mode, commander.intended_mode.custom_mode)


def autopilot_version(_world: World) -> Message:
    """Build AUTOPILOT_VERSION with the recorded contents."""
    return filled(
        mavlink.MAVLink_autopilot_version_message,
        capabilities=CAPABILITIES,
        flight_sw_version=SW_VERSION,
        middleware_sw_version=SW_VERSION,
        os_sw_version=OS_VERSION,
        board_version=1,
        flight_custom_version=CUSTOM_VERSION,
        middleware_custom_version=CUSTOM_VERSION,
        os_custom_version=[0] * 8,
        uid=UID,
        uid2=[0] * 18,
    )
