"""Messages about link, clock and surroundings, which most clients ignore; contents as recorded from PX4 v1.17.

pymavlink knows neither LINK_NODE_STATUS, TIME_ESTIMATE_TO_TARGET, EVENT nor CURRENT_EVENT_SEQUENCE.
"""

import struct

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.extras import RawMessage
from mock_autopilot.mavlink.messages import Message, boot_ms, boot_us, filled
from mock_autopilot.world import World

BOOTED_UNIX_S = 1_795_986_000
"""The simulator's clock at boot: 2026-11-29 21:00:00 UTC."""
TX_BYTES_PER_S, RX_BYTES_PER_S, TX_PER_S, RX_PER_S = 21_700, 3_700, 350.0, 75.0
"""Values of LINK_NODE_STATUS: a usual load of the onboard link."""
NO_ESTIMATES = struct.pack("<i", 0) + b"\xff" * 16
FIRST_SEQUENCE = 65533
SEQUENCE_RESET = 1
NOBODY = bytes(20)
EVENTS = {
    "Armed by external command": (0x0190CAF3, "6604"),
    "[logger]": (0x01125BEF, "66ea070b1d15101f"),
    "Takeoff detected": (0x01414569, "66"),
    "Disarming denied": (0x018AB9B5, "62"),
    "Disarmed by": (0x01F46777, "6604"),
    "Landing at current position": (0x0132B2DE, "66"),
    "Landing detected": (0x019638AC, "66"),
    "Switching to": (0x01A04397, "620000040304"),
}
"""Texts that are events too: id, and log levels and arguments (hex), as recorded. Health reports are not simulated."""


def system_time(world: World) -> Message:
    """Build SYSTEM_TIME from the simulator's clock."""
    return mavlink.MAVLink_system_time_message(BOOTED_UNIX_S * 1_000_000 + boot_us(world), boot_ms(world))


def link_node_status(world: World) -> Message:
    """A link under its usual load."""
    up_s = world.uptime_s
    counts = (round(TX_PER_S * up_s), round(RX_PER_S * up_s), 0)
    load = (TX_BYTES_PER_S, RX_BYTES_PER_S)
    return RawMessage(8, 117, struct.pack("<Q5I3H2B", boot_us(world), *load, *counts, *[0] * 5))


def scaled_pressure(world: World) -> Message:
    """The barometer: 955.8 hPa at the simulator's home, 0.113 hPa less for each metre."""
    height_m = -world.vehicle.sensor_state.motion.position_ned_m[2]
    return mavlink.MAVLink_scaled_pressure_message(boot_ms(world), 955.8 - 0.113 * height_m, 0.0, 1182, 0)


def distance_sensor(world: World) -> Message | None:
    """The range finder that looks down, if there is one, cm; below its ground it wraps round, as recorded."""
    if not world.vehicle.pilot.range_finder:
        return None
    height_m = -world.vehicle.sensor_state.motion.position_ned_m[2]
    range_cm = round(100 * height_m) % 65536
    return mavlink.MAVLink_distance_sensor_message(
        boot_ms(world), 0, 10000, range_cm, type=0, id=0, orientation=25, covariance=0
    )


def time_estimate_to_target(_world: World) -> Message:
    """Build TIME_ESTIMATE_TO_TARGET: there is no target."""
    return RawMessage(380, 232, NO_ESTIMATES)


def open_drone_id_location(world: World) -> Message:
    """Nothing but the barometer's height, and whether it flies: no place is known indoors."""
    above_sea_m = world.vehicle.origin.above_sea_m - world.vehicle.sensor_state.motion.position_ned_m[2]
    status = 2 if world.vehicle.estimator.in_air else 1
    return filled(
        mavlink.MAVLink_open_drone_id_location_message,
        id_or_mac=NOBODY,
        status=status,
        direction=36100,
        speed_horizontal=25500,
        speed_vertical=6300,
        altitude_barometric=above_sea_m,
        altitude_geodetic=-1000.0,
        height=-1000.0,
        timestamp=65535.0,
    )


def current_event_sequence(world: World) -> Message:
    """The last event's number; how many there were so far is the vehicle's to know."""
    told = world.vehicle.commander.events_told
    flags = SEQUENCE_RESET if told == 0 else 0
    return RawMessage(411, 106, struct.pack("<HB", (FIRST_SEQUENCE + told) % 65536, flags))


def event(text: str, number: int, at_ms: int) -> Message | None:
    """EVENT for a text that is one, with its number from 1 on; None for any other."""
    known = next((known for words, known in EVENTS.items() if text.startswith(words)), None)
    if known is None:
        return None
    id_, rest = known
    sequence = (FIRST_SEQUENCE + number) % 65536
    return RawMessage(410, 160, struct.pack("<IIHBB", id_, at_ms, sequence, 0, 0) + bytes.fromhex(rest))
