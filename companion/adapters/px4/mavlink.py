"""PX4's messages that MAVSDK has no call for, as MAVLink fields in JSON (MAVSDK's MavlinkDirect plugin).

PX4 sends HEARTBEAT at 1 Hz and refuses to send it faster. It grants CURRENT_MODE, and sends it at the rate asked for as
soon as its mode changes, so a mode is known within 50 ms instead of a second (PX4 v1.17, mavlink/streams).
"""

import asyncio
import contextlib
import ctypes
import json
import logging
import math
import struct
import threading
from collections.abc import Callable, Sequence
from typing import Any

from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

from companion.core.interfaces import AutopilotError
from companion.core.types import FlightMode

LOG = logging.getLogger(__name__)

_AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1; PX4's own system number is whatever MAVSDK found."""
_ARM_DISARM = 400
_KILL_ANYWAY = 21196
"""Parameter 2 of ARM_DISARM: in the air, too."""
_PARAMS = 7
_ARMED_BIT = 128
_PX4 = 12
_INT32, _REAL32 = 6, 9
"""MAV_PARAM_TYPE; PX4 has no others."""
_ASK_TIMES, _ASK_S, _POLL_S = 4, 0.25, 0.01

_AUTO = 4
_MODES = {
    1: FlightMode.MANUAL,
    2: FlightMode.ALTITUDE,
    3: FlightMode.POSITION,
    6: FlightMode.OFFBOARD,
    7: FlightMode.MANUAL,  # stabilized
}
_AUTO_MODES = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
}


_MOST = 100
"""States are never given back, 16 kB each: a link that comes and goes for days must not eat the memory."""


class CallbackThreads:
    """The native threads of one connection that have called us."""

    _kept = 0

    def __init__(self) -> None:
        self._known: set[int] = set()

    def keep(self) -> None:
        """Keep the calling thread's state of the interpreter, as of the first call on it."""
        ident = threading.get_ident()
        if ident in self._known or CallbackThreads._kept >= _MOST:
            return
        self._known.add(ident)
        CallbackThreads._kept += 1
        ctypes.pythonapi.PyGILState_Ensure()  # without a release


def flight_mode(custom_mode: int) -> FlightMode:
    """Return the flight mode of a custom_mode (px4_custom_mode.h: main mode in byte 2, AUTO's sub mode in byte 3)."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    return (_AUTO_MODES.get(sub) if main == _AUTO else _MODES.get(main)) or FlightMode.OTHER


class Px4Mavlink:
    """MAVLink requests and subscriptions. Callbacks run on MAVSDK's thread, in the order of arrival."""

    def __init__(self, system: Any) -> None:
        self._plugin = MavlinkDirect(system)
        self._target = {"target_system": system.get_system_id(), "target_component": _AUTOPILOT}
        self._params: dict[str, float] = {}
        self._threads = CallbackThreads()
        self.on("PARAM_VALUE", self._on_param)

    def on(self, name: str, take: Callable[[dict[str, Any]], None]) -> None:
        """Call `take` with the fields of every such message of the autopilot; NaN floats are None."""

        def heard(message: MavlinkMessage, _: Any) -> None:
            self._threads.keep()
            if message.component_id != _AUTOPILOT:
                return
            try:
                take(json.loads(message.fields_json))
            except Exception:  # MAVSDK would print it to standard output
                with contextlib.suppress(Exception):  # without memory, there is not even some for a log line
                    LOG.exception("a %s of the autopilot cannot be used", name)

        self._plugin.subscribe_message(name, heard)

    def on_heartbeat(self, take: Callable[[bool, FlightMode], None]) -> None:
        """Call `take` with armed state and mode of every HEARTBEAT."""

        def heard(fields: dict[str, Any]) -> None:
            if fields["autopilot"] == _PX4:
                take(bool(fields["base_mode"] & _ARMED_BIT), flight_mode(fields["custom_mode"]))

        self.on("HEARTBEAT", heard)

    def on_current_mode(self, take: Callable[[FlightMode, bool], None]) -> None:
        """Call `take` with PX4's mode, and True when a failsafe has chosen it (an intended mode of 0 is none)."""

        def heard(fields: dict[str, Any]) -> None:
            flown, chosen = fields["custom_mode"], fields["intended_custom_mode"]
            take(flight_mode(flown), chosen not in {0, flown})

        self.on("CURRENT_MODE", heard)

    def kill(self) -> None:
        """Send "motors off, in the air, too" once and at once, beside an ARM or DISARM that is not answered yet."""
        self.send_command(_ARM_DISARM, 0.0, _KILL_ANYWAY)

    def send_command(self, command: int, *params: float | None, confirmation: int = 0) -> None:
        """Send one COMMAND_LONG, once; None is NaN, and parameters left out are 0. AutopilotError if it cannot be."""
        values = (*params, *[0.0] * (_PARAMS - len(params)))
        named = {f"param{number}": value for number, value in enumerate(values, 1)}
        self._send(self._message("COMMAND_LONG", command=command, confirmation=confirmation, **named))

    async def params(self, names: Sequence[str]) -> dict[str, float]:
        """Return values of PX4's parameters; unknown ones are absent (PX4 does not answer), after a second.

        NaN for an integer from -8388607 to -1: PX4 sends integers byte by byte in a float, and these look like NaN.
        """
        self._params = {}
        for _ in range(_ASK_TIMES):
            for name in names:
                if name not in self._params:
                    self._send(self._message("PARAM_REQUEST_READ", param_id=name, param_index=-1))
            for _ in range(round(_ASK_S / _POLL_S)):
                if all(name in self._params for name in names):
                    break
                await asyncio.sleep(_POLL_S)
        return {name: self._params[name] for name in names if name in self._params}

    def _on_param(self, fields: dict[str, Any]) -> None:
        value, kind = fields["param_value"], fields["param_type"]
        if value is None:
            value = math.nan
        elif kind == _INT32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        if kind in {_INT32, _REAL32}:
            self._params = {**self._params, fields["param_id"]: float(value)}

    def _message(self, name: str, **fields: Any) -> MavlinkMessage:
        return MavlinkMessage(name, fields_json=json.dumps({**self._target, **fields}))

    def _send(self, message: MavlinkMessage) -> None:
        try:
            self._plugin.send_message(message)
        except MavsdkError as error:
            raise AutopilotError(f"{message.message_name} not sent: {error}") from error
