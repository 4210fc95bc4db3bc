"""Rates of the streamed messages: PX4's defaults on either link, and a client's changes."""

from dataclasses import dataclass, replace

from mock_autopilot.mavlink import extras
from mock_autopilot.mavlink import messages as m
from mock_autopilot.mavlink import messages_global as g
from mock_autopilot.mavlink import messages_status as st
from mock_autopilot.world import World

TICK_S = 0.004
"""PX4's streams run on a 250 Hz grid."""


@dataclass(frozen=True)
class Stream:
    """A message that can be streamed; a rate of 0 is off until a client sets an interval."""

    id: int
    rate_hz: float
    build: m.Builder
    first_s: float = 0.0
    """Time after boot before which it is not sent."""


DEFAULTS = (
    Stream(0, 1.0, m.heartbeat, 1.0),
    Stream(1, 5.0, m.sys_status, 0.2),
    Stream(2, 1.0, st.system_time, 1.0),
    Stream(4, 1.0, m.ping, 1.0),
    Stream(8, 1.0, st.link_node_status, 1.0),
    Stream(24, 8.0, g.gps_raw_int),
    Stream(29, 1.0, st.scaled_pressure, 1.0),
    Stream(30, 100.0, m.attitude),
    Stream(31, 50.0, m.attitude_quaternion),
    Stream(32, 30.0, m.local_position_ned),
    Stream(33, 50.0, g.global_position_int),
    Stream(36, 10.0, m.servo_output_raw),
    Stream(42, 1.0, m.mission_current, 0.8),
    Stream(65, 0.0, m.rc_channels),
    Stream(74, 10.0, m.vfr_hud),
    Stream(83, 10.0, m.attitude_target),
    Stream(85, 10.0, m.position_target_local_ned),
    Stream(105, 50.0, m.highres_imu),
    Stream(111, 10.0, m.timesync),
    Stream(115, 0.0, g.hil_state_quaternion),
    Stream(132, 10.0, st.distance_sensor),
    Stream(141, 10.0, m.altitude_message),
    Stream(147, 0.5, m.battery_status, 2.0),
    Stream(230, 1.0, m.estimator_status, 1.0),
    Stream(241, 0.5, m.vibration, 2.0),
    Stream(242, 0.5, g.home_position, 2.0),
    Stream(245, 5.0, m.extended_sys_state, 0.2),
    Stream(331, 30.0, m.odometry),
    Stream(380, 0.5, st.time_estimate_to_target, 1.7),
    Stream(411, 1 / 3, st.current_event_sequence, 1.8),
    Stream(436, 0.5, m.current_mode, 2.0),
    Stream(12901, 1.0, st.open_drone_id_location, 1.0),
)
GCS_RATES_HZ = {
    1: 1.0, 2: 0.0, 4: 0.1, 24: 5.0, 30: 50.0, 32: 50.0, 36: 50.0, 74: 4.0, 83: 37.0, 85: 50.0, 105: 0.0, 111: 0.0,
    132: 0.5, 141: 1.0, 230: 0.5, 241: 0.1, 245: 1.0, 331: 0.0,
}  # fmt: skip
"""Rates on a ground station's link that differ, as recorded in two flights; 0: not streamed there."""
ON_REQUEST: dict[int, m.Builder] = {
    49: g.gps_global_origin,
    148: m.autopilot_version,
    300: extras.protocol_version,
    395: extras.component_information,
    397: extras.component_metadata,
}
"""Messages that are only sent on request, never streamed."""
AVAILABLE_MODES = 435
HEARTBEAT, CURRENT_MODE = 0, 436
STATUS_S = 0.5
"""PX4 publishes its state when it changes and at 2 Hz; CURRENT_MODE waits for that, however often it is asked for."""
FAST_HZ = 50.0
"""Lowest rate at which a request may find no new sample because the stream has just taken it: PX4 answers DENIED."""


def _for_gcs(stream: Stream) -> Stream:
    """Return a stream as a ground station's link has it; there a slower one first waits for its interval."""
    rate_hz = GCS_RATES_HZ.get(stream.id, stream.rate_hz)
    first_s = max(stream.first_s, 1.0 / rate_hz) if 0.0 < rate_hz < stream.rate_hz else stream.first_s
    return replace(stream, rate_hz=rate_hz, first_s=first_s)


class Streams:
    """The schedule of one link's streamed messages."""

    def __init__(self, for_gcs: bool = False) -> None:
        self._streams = {stream.id: _for_gcs(stream) if for_gcs else stream for stream in DEFAULTS}
        streaming = [stream for stream in self._streams.values() if stream.rate_hz > 0.0]
        self._interval_s = {stream.id: 1.0 / stream.rate_hz for stream in streaming}
        self._due_s = {stream.id: stream.first_s for stream in streaming}
        self._sent_s: dict[int, float] = {}
        self._status: tuple[object, ...] = ()
        self._status_s, self._status_is_new = -1.0, False

    def due(self, world: World) -> list[m.Message]:
        """Return the messages that are due; a late call sends each once, not a burst."""
        now_s = world.uptime_s
        self._publish_status(world, now_s)
        out = []
        for id_ in [id_ for id_, due_s in self._due_s.items() if now_s >= due_s - 1e-6]:
            if id_ == CURRENT_MODE and not self._status_is_new:
                continue
            due_s = self._due_s[id_]
            interval_s = self._interval_s[id_]
            self._due_s[id_] = due_s + interval_s * max(1, int((now_s - due_s) / interval_s) + 1)
            message = self._streams[id_].build(world)
            if message is not None:
                self._sent_s[id_] = now_s
                out.append(message)
                self._status_is_new &= id_ != CURRENT_MODE
        return out

    def _publish_status(self, world: World, now_s: float) -> None:
        """Mark vehicle_status as published, as PX4's commander does: on change, after a command, and at 2 Hz."""
        commander = world.vehicle.commander
        shown = (commander.mode, commander.intended_mode, commander.armed, commander.failsafe)
        status = (*shown, commander.commands_handled)
        if status != self._status or now_s - self._status_s >= STATUS_S - 1e-6:
            self._status, self._status_s, self._status_is_new = status, now_s, True

    def request(self, id_: int, world: World) -> list[m.Message]:
        """Return the answer to REQUEST_MESSAGE, empty when PX4 would have nothing to send."""
        if id_ == AVAILABLE_MODES:
            return extras.available_modes(world)
        stream = self._streams.get(id_)
        sample_taken = world.uptime_s - self._sent_s.get(id_, -1.0) < TICK_S - 1e-6
        if stream is not None and stream.rate_hz >= FAST_HZ and sample_taken:
            return []
        builder = ON_REQUEST.get(id_) or (stream.build if stream else None)
        message = builder(world) if builder else None
        return [] if message is None else [message]

    def set_interval(self, id_: int, interval_us: float, now_s: float) -> bool:
        """Set an interval: 0 is the default rate, -1 stops; return False for HEARTBEAT and what has no stream."""
        stream = self._streams.get(id_)
        if stream is None or id_ == HEARTBEAT:
            return False
        if interval_us < 0 or (interval_us == 0 and stream.rate_hz == 0.0):
            self._due_s.pop(id_, None)
            return True
        self._interval_s[id_] = interval_us / 1e6 if interval_us > 0 else 1.0 / stream.rate_hz
        self._due_s[id_] = now_s
        return True

    def interval_us(self, id_: int) -> int:
        """Return the interval of a message, us; -1 if it is not streamed."""
        return round(self._interval_s[id_] * 1e6) if id_ in self._due_s else -1
