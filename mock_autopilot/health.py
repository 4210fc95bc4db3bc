"""SYS_STATUS sensor health bits as recorded from PX4 v1.17."""

from mock_autopilot.vehicle import Vehicle

BASE = 0x0320883F
"""All sensors there, no position, not armable."""
POSITION_CONTROL = 0x4000
PREARM = 0x10000000
BOOT = 0x0321C83F
"""Before the first checks have run."""


def sensors_health(vehicle: Vehicle) -> int:
    """Health bits of SYS_STATUS; PREARM says that arming in the chosen mode would be accepted."""
    if vehicle.now_s < 2.0:
        return BOOT
    now = vehicle.situation
    ready = vehicle.commander.checked(now) and now.local_ok
    bits = BASE | (POSITION_CONTROL if ready else 0)
    return bits | (PREARM if vehicle.commander.can_arm(now) else 0)
