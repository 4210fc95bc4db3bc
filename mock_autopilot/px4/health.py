"""SYS_STATUS sensor bits as recorded from PX4 v1.17."""

from mock_autopilot.px4.innovation_checks import HORIZONTAL_UNSTABLE
from mock_autopilot.px4.vehicle import Vehicle

SENSORS = 0x0200400F
"""Inertial sensors, barometer, battery and position control: there, used and healthy."""
LOGGING = 0x1000000
RC_RECEIVER = 0x10000
GPS = 0x20
BATTERY = 0x2000000
BASE = 0x0320883F
"""All sensors healthy, no position, not armable, no sticks."""
POSITION_CONTROL = 0x4000
PREARM = 0x10000000
BOOT = 0x0321C83F
"""Before the first checks have run."""
CHECKED_S = 2.0
NO_LOG = -1


def sensors_present(vehicle: Vehicle) -> int:
    """Return the bits of the sensors that the vehicle has."""
    fitted = _fitted(vehicle)
    return fitted | RC_RECEIVER if fitted and vehicle.failsafe_flags.remote else fitted


def sensors_enabled(vehicle: Vehicle) -> int:
    """Return the bits of the sensors in use; a pilot's sticks are always among them."""
    return _fitted(vehicle) and _fitted(vehicle) | RC_RECEIVER


def _fitted(vehicle: Vehicle) -> int:
    if vehicle.now_s < CHECKED_S:
        return 0
    logging = 0 if int(vehicle.params["SDLOG_MODE"]) == NO_LOG else LOGGING
    return SENSORS | logging | (GPS if vehicle.estimator.uses_gps else 0)


def sensors_health(vehicle: Vehicle) -> int:
    """Return the health bits of SYS_STATUS; PREARM says that arming in the chosen mode would be accepted."""
    if vehicle.now_s < CHECKED_S:
        return BOOT
    now = vehicle.commander.last_checks(vehicle.failsafe_flags)
    ready = vehicle.commander.checked(now) and now.local_ok and HORIZONTAL_UNSTABLE not in now.preflight_failures
    bits = BASE | (POSITION_CONTROL if ready else 0) | (RC_RECEIVER if now.remote else 0)
    low = vehicle.commander.battery_low
    return (bits & ~BATTERY if low else bits) | (PREARM if vehicle.commander.can_arm(now) else 0)
