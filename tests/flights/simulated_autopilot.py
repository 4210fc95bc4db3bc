"""PX4 behind the port in simulated time: MAVLink messages straight into the mock's receiver and out of its sender."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from companion.adapters.px4.mavlink import flight_mode
from companion.config.px4_config import Px4Config
from companion.core.interfaces import AutopilotError
from companion.core.types import NOT_HEARD, Array, AttitudeThrust, AutopilotStatus, FlightMode
from companion.geometry.frames import flip_quat, flip_yz
from mock_autopilot.mavlink.streams import DEFAULTS
from tests.mock_autopilot.bench import Bench, Sent

ARMED_BIT = 128
ON_GROUND = 1
CURRENT_MODE = 436
MODE_EVERY_US = 50_000
"""Interval that the real adapter asks for."""
STREAM_KEPT_S = 3.0
"""MAVSDK stops its stream with a HEARTBEAT that shows another mode, but not this soon after it asked for OFFBOARD."""
SILENT_S = 3.0
"""Without HEARTBEAT for so long MAVSDK counts as disconnected."""
KILL_EVERY_S = 0.1
_UNKNOWN = [math.nan] * 21
"""A covariance that says nothing."""
_READ = frozenset({0, 1, 31, 32, 245, CURRENT_MODE})
"""Messages that come in streams and are looked at; what nobody reads is not even sent, which takes its time."""


class SimulatedAutopilot:
    """interfaces.Autopilot."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.setpoints: list[tuple[float, AttitudeThrust]] = []
        self.land_calls = 0
        self.deaf_to_land = 0
        """So many land commands are lost."""
        self._read = 0
        self._offboard_asked_s = -math.inf
        for stream in DEFAULTS:
            if stream.id not in _READ:
                bench.link.streams.set_interval(stream.id, -1, bench.now_s)
        self._status = NOT_HEARD
        self._takes: dict[str, Callable[[Sent], dict[str, Any]]] = {
            "HEARTBEAT": self._on_heartbeat,
            "CURRENT_MODE": self._on_current_mode,
            "EXTENDED_SYS_STATE": lambda sent: {"in_air": sent.message.landed_state != ON_GROUND},
            "ATTITUDE_QUATERNION": self._on_attitude,
            "LOCAL_POSITION_NED": _on_local,
            "SYS_STATUS": _on_battery,
            "STATUSTEXT": self._on_text,
        }

    def status(self) -> AutopilotStatus:
        """Return the status as the messages that came last show it."""
        now_s = self._bench.now_s
        if self._read < len(self._bench.sent):
            self._read_news()
        heard = self._status.heartbeat_s
        connected = now_s - heard < SILENT_S or math.isinf(heard)
        return self._status if connected else replace(self._status, connected=False)

    def _read_news(self) -> None:
        fresh = self._bench.sent[self._read :]
        self._read += len(fresh)
        news: dict[str, Any] = {}
        for sent in fresh:
            take = self._takes.get(sent.type)
            if take is not None:
                news |= take(sent) | {"heard_s": sent.time_s}
        if news:
            self._status = replace(self._status, **news)

    def _on_heartbeat(self, sent: Sent) -> dict[str, Any]:
        if math.isinf(self._status.heartbeat_s):
            self._ask_for_modes()
        mode = flight_mode(sent.message.custom_mode)
        if mode is not FlightMode.OFFBOARD and sent.time_s - self._offboard_asked_s > STREAM_KEPT_S:
            self._bench.setpoint = None
        return {"heartbeat_s": sent.time_s, "armed": bool(sent.message.base_mode & ARMED_BIT), "mode": mode}

    def _on_current_mode(self, sent: Sent) -> dict[str, Any]:
        flown, chosen = sent.message.custom_mode, sent.message.intended_custom_mode
        return {"mode": flight_mode(flown), "failsafe": chosen not in {0, flown}}

    def _on_attitude(self, sent: Sent) -> dict[str, Any]:
        m = sent.message
        boot_s = m.time_boot_ms * 1e-3
        if boot_s < self._status.boot_s:  # it has forgotten what was asked of it
            self._ask_for_modes()
        attitude = flip_quat(np.array([m.q1, m.q2, m.q3, m.q4]))
        rate = flip_yz(np.array([m.rollspeed, m.pitchspeed, m.yawspeed]))
        return {"q_w_flu_wxyz": attitude, "rate_flu_radps": rate, "attitude_s": sent.time_s, "boot_s": boot_s}

    def _on_text(self, sent: Sent) -> dict[str, Any]:
        text = sent.message.text if isinstance(sent.message.text, str) else sent.message.text.decode()
        whole = (self._status.last_text if sent.message.chunk_seq else "") + text.strip()
        return {"last_text": whole, "text_s": sent.time_s}

    def _ask_for_modes(self) -> None:
        self.command(511, CURRENT_MODE, MODE_EVERY_US)

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        self.setpoints.append((self._bench.now_s, setpoint))
        q = flip_quat(setpoint.q_w_flu_wxyz).tolist()
        self._bench.target(float(setpoint.thrust), tuple(q))
        self._bench.hear(self._bench.setpoint)

    def send_vision(self, position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        x, y, z = flip_yz(position_w_m).tolist()
        w, i, j, k = flip_quat(q_w_flu_wxyz).tolist()
        roll, pitch = (
            math.atan2(2 * (w * i + j * k), 1 - 2 * (i * i + j * j)),
            math.asin(max(-1.0, min(1.0, 2 * (w * j - k * i)))),
        )
        yaw = math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
        self._bench.hear(mavlink.MAVLink_vision_position_estimate_message(0, x, y, z, roll, pitch, yaw, _UNKNOWN))

    def stop_stream(self) -> None:
        self._bench.setpoint = None

    async def start_offboard(self) -> None:
        self.command(176, 1.0, 6.0, 0.0)

    async def arm(self) -> None:
        self.command(400, 1.0)

    async def disarm(self) -> None:
        """Ask again every half second for 5 s, as the real adapter does."""
        for _ in range(10):
            self.command(400, 0.0)
            await self._pass_time(0.5)
            if not self.status().armed:
                return
        raise AutopilotError("still armed")

    async def land(self) -> None:
        """AutopilotError without an answer, or when it is no."""
        self.land_calls += 1
        if self.deaf_to_land:
            self.deaf_to_land -= 1
            raise AutopilotError("the autopilot did not answer the command to land")
        before, asked_s = len(self._bench.sent), self._bench.now_s
        self.command(21)
        while not (results := self._results(21, before)):
            if self._bench.now_s - asked_s > Px4Config().answer_timeout_s:
                raise AutopilotError("the autopilot did not answer the command to land")
            await asyncio.sleep(0)
        if results[-1] != 0:
            raise AutopilotError(f"the autopilot refused to land: {self.status().last_text}")

    async def kill(self) -> None:
        """Again and again until it shows, as the real adapter does."""
        for _ in range(round(Px4Config().answer_timeout_s / KILL_EVERY_S)):
            self.command(400, 0.0, 21196.0)
            await self._pass_time(KILL_EVERY_S)
            if not self.status().armed:
                return
        raise AutopilotError("the autopilot was told to stop the motors but does not show it: look at the link")

    def _results(self, command: int, before: int) -> list[int]:
        answers = [sent.message for sent in self._bench.sent[before:] if sent.type == "COMMAND_ACK"]
        return [answer.result for answer in answers if answer.command == command]

    async def _pass_time(self, for_s: float) -> None:
        end_s = self._bench.now_s + for_s
        while self._bench.now_s < end_s:  # noqa: ASYNC110 - simulated time, no event tells of it
            await asyncio.sleep(0)

    def command(self, command: int, *params: float) -> None:
        """One COMMAND_LONG, unused parameters NaN as MAVSDK sends them."""
        if command == 176:
            self._offboard_asked_s = self._bench.now_s
        filled = [*params, *[np.nan] * (7 - len(params))]
        self._bench.hear(mavlink.MAVLink_command_long_message(self._bench.system, 1, command, 0, *filled))


def _on_local(sent: Sent) -> dict[str, Any]:
    velocity = flip_yz(np.array([sent.message.vx, sent.message.vy, sent.message.vz]))
    return {"velocity_w_mps": velocity, "velocity_s": sent.time_s}


def _on_battery(sent: Sent) -> dict[str, Any]:
    return {
        "battery_fraction": sent.message.battery_remaining / 100.0,
        "battery_v": sent.message.voltage_battery * 1e-3,
    }
