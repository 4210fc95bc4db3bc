"""Handlers for the messages that PX4 receives."""

import math
import struct
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.mavlink.commands import COMMANDERS, Params, answer
from mock_autopilot.mavlink.messages import Message
from mock_autopilot.mavlink.streams import Streams
from mock_autopilot.physics.geodesy import Origin
from mock_autopilot.px4.params import Param
from mock_autopilot.px4.setpoint import AttitudeTarget, Triple
from mock_autopilot.px4.vision import VisionSample
from mock_autopilot.px4.vocabulary import Result
from mock_autopilot.world import World

COMPONENT = 1
BROADCAST = 0
SET_MODE_COMMAND = 176
GPS_GLOBAL_ORIGIN = 49
PARAMS_PER_TICK = 5
"""PARAM_REQUEST_LIST: 879 values in about 0.8 s."""
BODY_FRD_FRAME = 12
FASTEST_MPS = 1e3


class Receiver:
    """The handlers of one link's messages; answers leave through `send`."""

    def __init__(self, world: World, streams: Streams, send: Callable[[Message], None]) -> None:
        self._world = world
        self._system = int(world.vehicle.params["MAV_SYS_ID"])  # PX4 reads it at boot
        self._streams = streams
        self._send = send
        self._listing: Iterator[Param] | None = None
        self._announce: list[tuple[float, str]] = []
        self._answers: list[Message] = []
        self._orders: list[tuple[int, Any, Params]] = []
        """For the commander, and how many passes it had made when they came: it answers with the next one."""
        self._handlers: dict[str, Callable[[Any], None]] = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "SET_ATTITUDE_TARGET": self._attitude_target,
            "PARAM_REQUEST_READ": self._param_read,
            "PARAM_REQUEST_LIST": self._param_list,
            "PARAM_SET": self._param_set,
            "PING": self._ping,
            "TIMESYNC": self._timesync,
            "SET_GPS_GLOBAL_ORIGIN": self._set_origin,
            "VISION_POSITION_ESTIMATE": self._vision,
            "ODOMETRY": self._odometry,
            "ATT_POS_MOCAP": self._mocap,
            "MANUAL_CONTROL": self._manual_control,
        }

    def handle(self, message: Any) -> None:
        """Act on one decoded message; unknown ones are ignored."""
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(message)

    def pop_due(self) -> list[Message]:
        """Return parameter messages that are due: the list, five a tick, and the repetition after a change."""
        due = [name for at_s, name in self._announce if self._world.uptime_s >= at_s]
        self._announce = [(at_s, name) for at_s, name in self._announce if self._world.uptime_s < at_s]
        out = [self._value(param) for name in due if (param := self._params.find(name)) is not None]
        while self._listing is not None and len(out) < PARAMS_PER_TICK:
            param = next(self._listing, None)
            if param is None:
                self._listing = None
            else:
                out.append(self._value(param))
        return out

    def pop_answers(self) -> list[Message]:
        """Return the answers to commands; the commander's come with its next pass, before the command takes effect."""
        vehicle = self._world.vehicle
        while self._orders and self._orders[0][0] != vehicle.commander_passes:
            _, m, params = self._orders.pop(0)
            reply = answer(m.command, params, self._world, self._streams)
            self._answers += [_ack(m.command, result, m) for result in reply.results]
            vehicle.commander.commands_handled += 1
        answers, self._answers = self._answers, []
        return answers

    # -- commands --------------------------------------------------------------------------------

    def _command_long(self, m: Any) -> None:
        if m.target_system == self._system and m.target_component in {BROADCAST, COMPONENT}:
            self._command(m, (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7))

    def _command_int(self, m: Any) -> None:
        if m.target_system == self._system and m.target_component in {BROADCAST, COMPONENT}:
            self._command(m, (m.param1, m.param2, m.param3, m.param4, float(m.x), float(m.y), m.z))

    def _command(self, m: Any, params: Params) -> None:
        """Answer at the next tick; DO_SET_MODE twice, by the receiver and by the commander."""
        if m.command == SET_MODE_COMMAND:
            self._answers.append(_ack(m.command, Result.ACCEPTED, m))
        if m.command in COMMANDERS:
            self._orders.append((self._world.vehicle.commander_passes, m, params))
            return
        reply = answer(m.command, params, self._world, self._streams)
        self._answers += [*reply.messages, *(_ack(m.command, result, m) for result in reply.results)]

    def _set_mode(self, m: Any) -> None:
        """Handle the legacy message SET_MODE: one ACK, for DO_SET_MODE."""
        if m.target_system != self._system:
            return
        main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF
        self._send(_ack(SET_MODE_COMMAND, self._world.vehicle.set_mode(m.base_mode, main, sub), m))

    def _manual_control(self, m: Any) -> None:
        if m.target == self._system:
            self._world.vehicle.on_manual_control((m.x / 1e3, m.y / 1e3, m.z / 500.0 - 1.0, m.r / 1e3))

    # -- setpoints and poses ---------------------------------------------------------------------

    def _attitude_target(self, m: Any) -> None:
        if m.target_system not in {BROADCAST, self._system} or m.target_component not in {BROADCAST, COMPONENT}:
            return
        w, x, y, z = m.q
        rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
        self._world.vehicle.attitude_target(AttitudeTarget(m.type_mask, (w, x, y, z), rates, m.thrust))

    def _set_origin(self, m: Any) -> None:
        if m.target_system in {BROADCAST, self._system}:
            self._world.vehicle.set_origin(Origin(m.latitude / 1e7, m.longitude / 1e7, m.altitude / 1e3))
            for origin in self._streams.request(GPS_GLOBAL_ORIGIN, self._world):
                self._send(origin)

    def _vision(self, m: Any) -> None:
        self._world.vehicle.on_vision(VisionSample((m.x, m.y, m.z), m.yaw, None, m.reset_counter))

    def _mocap(self, m: Any) -> None:
        self._world.vehicle.on_vision(VisionSample((m.x, m.y, m.z), _yaw(m.q)))

    def _odometry(self, m: Any) -> None:
        """Handle ODOMETRY: position in a local NED-like frame, velocity in the child frame if it is finite."""
        velocity: Triple | None = (m.vx, m.vy, m.vz)
        if not all(abs(part) < FASTEST_MPS for part in (m.vx, m.vy, m.vz)):  # NaN says: not measured
            velocity = None
        elif m.child_frame_id == BODY_FRD_FRAME:
            velocity = _body_to_world(m.q, (m.vx, m.vy, m.vz))
        self._world.vehicle.on_vision(VisionSample((m.x, m.y, m.z), _yaw(m.q), velocity, m.reset_counter))

    # -- parameters ------------------------------------------------------------------------------

    @property
    def _params(self) -> Any:
        return self._world.vehicle.params

    def _param_read(self, m: Any) -> None:
        if m.target_system != self._system or m.target_component not in {BROADCAST, COMPONENT}:
            return
        param = self._params.find(m.param_id) if m.param_index < 0 else self._params.at(m.param_index)
        if param is not None:  # to an unknown name PX4 says nothing
            self._send(self._value(param))

    def _param_list(self, m: Any) -> None:
        if m.target_system == self._system and m.target_component in {BROADCAST, COMPONENT}:
            self._listing = iter(self._params)

    def _param_set(self, m: Any) -> None:
        if m.target_system != self._system or m.target_component not in {BROADCAST, COMPONENT}:
            return
        param = self._params.change_from_wire(m.param_id, struct.pack("<f", m.param_value), m.param_type)
        if param is not None:
            self._send(self._value(param))
            self._announce.append((self._world.uptime_s + 0.01, param.name))

    def _value(self, param: Param) -> Message:
        (as_float,) = struct.unpack("<f", param.wire_bytes)
        name = param.name.encode()
        return mavlink.MAVLink_param_value_message(name, as_float, param.type, len(self._params), param.index)

    # -- time ------------------------------------------------------------------------------------

    def _ping(self, m: Any) -> None:
        if m.target_system == 0 and m.target_component == 0:
            system, component = m.get_srcSystem(), m.get_srcComponent()
            self._send(mavlink.MAVLink_ping_message(m.time_usec, m.seq, system, component))

    def _timesync(self, m: Any) -> None:
        if m.tc1 == 0:
            self._send(mavlink.MAVLink_timesync_message(round(self._world.uptime_s * 1e9), m.ts1))


def _ack(command: int, result: Result, to: Any) -> Message:
    system, component = to.get_srcSystem(), to.get_srcComponent()
    return mavlink.MAVLink_command_ack_message(command, int(result), 0, 0, system, component)


def _yaw(q: Any) -> float:
    w, x, y, z = q
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _body_to_world(q: Any, v: Triple) -> Triple:
    """Rotate a body vector by the unit quaternion w x y z."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx)
