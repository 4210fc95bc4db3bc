"""PX4 over MAVSDK's native 4.x API: setpoints on the calling thread, commands as messages.

NED, FRD and degrees exist here alone (`geometry/frames.py` converts). Three habits of PX4 and MAVSDK shape this file:
- A mode command gets two COMMAND_ACKs, the first of which only means "well-formed". So a mode, and the armed state,
  count as reached only when PX4's own messages show them (`mavlink`).
- MAVSDK re-sends the last setpoint at 20 Hz by itself, for as long as the process lives and PX4 shows OFFBOARD.
- `mavsdk.asyncio` runs every call in the shared thread pool, where unanswered commands can starve a setpoint for
  seconds, and MAVSDK crashes when it is destroyed under a call that is not answered yet. The synchronous setpoint takes
  0.1 ms, and commands are messages of our own (`commands`).
"""

import asyncio
import contextlib
import math
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import replace
from typing import Any

from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mocap import AngleBody, Covariance, Mocap, PositionBody, VisionPositionEstimate
from mavsdk.plugins.offboard import ActuatorControl, Attitude, Offboard

from companion.adapters.px4.commands import CommandSender, MavResult
from companion.adapters.px4.mavlink import Px4Mavlink
from companion.adapters.px4.telemetry import LocalEstimate, Px4Telemetry
from companion.config.px4_config import Px4Config
from companion.core.interfaces import AutopilotError, Clock
from companion.core.types import Array, AttitudeThrust, AutopilotStatus, FlightMode
from companion.geometry.frames import euler_ned_frd_deg, flip_yz

_POLL_S = 0.02
_RETRY_S = 0.5
_WORDS_S = 0.5
_KILL_AGAIN_S = 0.1
_REPEAT_S = 0.1

_LAND_HERE = (0.0, 0.0, 0.0, None)
"""Parameters of NAV_LAND; yaw is NaN: as it is."""
_ARM_DISARM, _NAV_LAND, _DO_SET_MODE, _SET_MESSAGE_INTERVAL = 400, 21, 176, 511
"""MAV_CMD."""
_ARMED_BIT, _CUSTOM_MODE_BIT = 128, 1
"""MAV_MODE_FLAG."""
_OFFBOARD_MAIN_MODE = 6
"""px4_custom_mode.h."""
_CURRENT_MODE, _EXTENDED_SYS_STATE = 436, 245
_MODE_RATE_HZ = 20.0
_LANDED_RATE_HZ = 5.0
"""Rate that PX4's onboard links have by default; other kinds of link send it more slowly or not at all."""


class Px4:
    """Autopilot interface to PX4 over MAVSDK."""

    def __init__(self, system: Any, config: Px4Config, clock: Clock, own_ids: tuple[int, int]) -> None:
        """`own_ids` are our system and component in MAVLink."""
        self._config, self._clock = config, clock
        self._loop = asyncio.get_running_loop()
        self._offboard, self._mocap, self._mavlink = Offboard(system), Mocap(system), Px4Mavlink(system)
        self._commands = CommandSender(self._mavlink, own_ids)
        self._telemetry = Px4Telemetry(system, self._mavlink, clock, config.battery_id, self._ask_again)
        self._last_setpoint: Attitude | None = None
        """The setpoint that MAVSDK repeats; None while nothing leaves."""
        self._stream_begun_s = math.inf
        """When the first setpoint of this stream left: PX4 begins to say then what keeps it from arming."""
        self._asking: set[asyncio.Task[Any]] = set()
        self.other_autopilots: tuple[str, ...] = ()
        """Other autopilots on the link, each in a few words."""
        self.warnings: tuple[str, ...] = ()
        """Warnings about the link for the operator."""

    async def ask_for_messages(self) -> None:
        """Ask for the message that shows a change of mode within 50 ms; a warning when PX4 does not grant it.

        And for the land detector's, which comes late, or not at all, on links that are not set up as onboard.
        """
        if not await self._ask_for_both():
            self.warnings = (
                "the autopilot does not send CURRENT_MODE faster (an older PX4?): a change of mode by the pilot or a "
                "failsafe is seen up to a second late",
            )

    async def close(self) -> None:
        """Cancel all pending message requests."""
        for task in self._asking:
            task.cancel()
        await asyncio.gather(*self._asking, return_exceptions=True)

    def _ask_again(self) -> None:
        """Request the messages again after a reboot; called on MAVSDK's thread."""
        self._loop.call_soon_threadsafe(lambda: self._begin(self._ask_for_both()))

    async def _ask_for_both(self) -> bool:
        granted = await self._ask_for(_CURRENT_MODE, _MODE_RATE_HZ)
        self._begin(self._ask_for(_EXTENDED_SYS_STATE, _LANDED_RATE_HZ))
        return granted

    async def _ask_for(self, message: int, rate_hz: float) -> bool:
        """Ask for a message at this rate; False when it is not granted."""
        try:
            answer = await self._commands.send(
                _SET_MESSAGE_INTERVAL, message, 1e6 / rate_hz, timeout_s=self._config.answer_timeout_s
            )
        except (AutopilotError, TimeoutError):
            return False
        return answer is MavResult.ACCEPTED

    def _begin(self, asking: Coroutine[Any, Any, Any]) -> None:
        task = self._loop.create_task(asking, name="companion.px4.ask")
        self._asking.add(task)
        task.add_done_callback(self._asking.discard)

    def status(self) -> AutopilotStatus:
        """Return the last known state; never waits."""
        status = self._telemetry.status
        return replace(status, other_autopilots=self.other_autopilots) if self.other_autopilots else status

    def local(self) -> LocalEstimate:
        """Return PX4's own local position estimate; never waits."""
        return self._telemetry.local

    async def params(self, names: Sequence[str]) -> dict[str, float]:
        """Return values of PX4's parameters; unknown or unanswered ones are absent."""
        return await self._mavlink.params(names)

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        """Send one attitude setpoint on the calling thread (0.1 ms)."""
        roll, pitch, yaw = euler_ned_frd_deg(setpoint.q_w_flu_wxyz)
        try:
            self._offboard.set_attitude(sent := Attitude(roll, pitch, yaw, float(setpoint.thrust)))
        except MavsdkError as error:
            raise AutopilotError(f"setpoint not sent: {error}") from error
        if self._last_setpoint is None:
            self._stream_begun_s = self._clock.now_s()
        self._last_setpoint = sent

    def send_vision(self, position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        """Forward one pose as VISION_POSITION_ESTIMATE, stamped by MAVSDK; its covariance is PX4's parameter."""
        x, y, z = (float(v) for v in flip_yz(position_w_m))
        angles = AngleBody(*(math.radians(angle) for angle in euler_ned_frd_deg(q_w_flu_wxyz)))
        estimate = VisionPositionEstimate(0, PositionBody(x, y, z), angles, Covariance([math.nan]), 0)
        try:
            self._mocap.set_vision_position_estimate(estimate)
        except MavsdkError as error:
            raise AutopilotError(f"vision pose not sent: {error}") from error

    def stop_stream(self) -> None:
        """Silence MAVSDK's own repetition of the last setpoint (5 us); nothing is sent and no mode commanded.

        MAVSDK repeats setpoints of one kind at a time: one of another kind, with nothing in it, replaces the attitude.
        """
        self._last_setpoint, self._stream_begun_s = None, math.inf
        self._offboard.set_actuator_control(ActuatorControl([]))

    async def start_offboard(self) -> None:
        """Ask for OFFBOARD and wait until the autopilot shows it; a setpoint must have been sent before."""
        since_s = self._clock.now_s()
        repeating = self._loop.create_task(self._repeat_setpoint(), name="companion.px4.repeat")
        try:
            flags = _CUSTOM_MODE_BIT | (_ARMED_BIT if self._telemetry.status.armed else 0)
            await self._call("start offboard mode", since_s, _DO_SET_MODE, flags, _OFFBOARD_MAIN_MODE)
            await self._shown(
                "OFFBOARD mode", since_s, lambda: self._telemetry.mode_since(since_s) is FlightMode.OFFBOARD
            )
        finally:
            repeating.cancel()

    async def _repeat_setpoint(self) -> None:
        """Keep MAVSDK at its repetition, which it gives up 3 s after its begin while the mode is not OFFBOARD yet."""
        while True:
            if self._last_setpoint is not None:
                with contextlib.suppress(MavsdkError):
                    self._offboard.set_attitude(self._last_setpoint)
            await asyncio.sleep(_REPEAT_S)

    async def arm(self) -> None:
        """Arm and wait until the HEARTBEAT shows it; asks again while PX4 says no, as it does while it warms up."""
        since_s = self._clock.now_s()
        await self._insist("arm", since_s, self._config.arm_timeout_s, _ARM_DISARM, 1.0)
        await self._shown("armed", since_s, lambda: self._telemetry.armed_since(since_s) is True)

    async def disarm(self) -> None:
        """Disarm and wait until shown; PX4 refuses in the air and for about a second after touchdown."""
        since_s = self._clock.now_s()
        await self._insist("disarm", since_s, self._config.answer_timeout_s, _ARM_DISARM, 0.0)
        await self._shown("disarmed", since_s, lambda: self._telemetry.armed_since(since_s) is False)

    async def land(self) -> None:
        """Hand over to PX4's own landing and wait until OFFBOARD is left."""
        since_s = self._clock.now_s()
        await self._call("land", since_s, _NAV_LAND, *_LAND_HERE)
        still = {None, FlightMode.OFFBOARD}
        await self._shown("leaving OFFBOARD", since_s, lambda: self._telemetry.mode_since(since_s) not in still)

    async def kill(self) -> None:
        """Stop the motors at once, also in the air; repeated until the HEARTBEAT shows it."""
        since_s = self._clock.now_s()
        while self._telemetry.armed_since(since_s) is not False:
            self._mavlink.kill()
            if self._clock.now_s() - since_s > self._config.answer_timeout_s:
                said = await self._reason("look at the link", since_s)
                raise AutopilotError(f"the autopilot was told to stop the motors but does not show it: {said}")
            await asyncio.sleep(_KILL_AGAIN_S)

    async def _call(self, what: str, since_s: float, command: int, *params: float | None) -> None:
        try:
            answer = await self._commands.send(command, *params, timeout_s=self._config.answer_timeout_s)
        except TimeoutError as error:
            said = "; ".join(self._words(since_s))
            raise AutopilotError(
                f"the autopilot did not answer the command to {what}{f': {said}' if said else ''}"
            ) from error
        if answer is not MavResult.ACCEPTED:
            result = answer.name.lower().replace("_", " ")
            raise AutopilotError(f"the autopilot refused to {what}: {await self._reason(result, since_s)}")

    async def _insist(self, what: str, since_s: float, timeout_s: float, command: int, *params: float | None) -> None:
        while True:
            try:
                await self._call(what, since_s, command, *params)
            except AutopilotError:
                if self._clock.now_s() - since_s + _RETRY_S > timeout_s:
                    raise
                await asyncio.sleep(_RETRY_S)
            else:
                return

    async def _shown(self, what: str, since_s: float, reached: Callable[[], bool]) -> None:
        asked_s = self._clock.now_s()
        while not reached():
            if self._clock.now_s() - asked_s > self._config.answer_timeout_s:
                said = await self._reason("no reason given", since_s)
                raise AutopilotError(f"the autopilot accepted the command but does not show {what}: {said}")
            await asyncio.sleep(_POLL_S)

    async def _reason(self, result: str, since_s: float) -> str:
        """Return the autopilot's own words, which may come a little after its refusal; `result` if it gives none."""
        for _ in range(round(_WORDS_S / _POLL_S)):
            if self._telemetry.texts_since(since_s):
                break
            await asyncio.sleep(_POLL_S)
        return "; ".join(self._words(since_s)) or result

    def _words(self, since_s: float) -> list[str]:
        """Return what the autopilot has said since a command, each sentence once, and since this stream began.

        PX4 names what is wrong ("Preflight Fail: ...") when the setpoints begin, before it is asked to arm; its refusal
        says only that something is. In the air the stream has begun long ago: there, the command alone counts.
        """
        on_the_ground = not self._telemetry.status.armed
        begun_s = min(since_s, self._stream_begun_s) if on_the_ground else since_s
        return list(dict.fromkeys(self._telemetry.texts_since(begun_s)))
