"""PX4 through MAVSDK's native 4.x API: setpoints on the calling thread, commands by callback.

NED, FRD and degrees exist here alone. Three habits of PX4 and MAVSDK shape this file:
- A mode command gets two COMMAND_ACKs and MAVSDK believes the first, which only means "well-formed". So a mode, and the
  armed state, count as reached only when PX4's own messages show them (`direct`).
- MAVSDK re-sends the last setpoint at 20 Hz by itself, for as long as the process lives and PX4 shows OFFBOARD.
- `mavsdk.asyncio` runs every call in the shared thread pool, where unanswered commands can starve a setpoint for
  seconds, and MAVSDK crashes when it is destroyed under a blocking call. The synchronous setpoint takes 0.1 ms, and the
  commands that take a callback block nobody.
"""

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

from mavsdk.component_type import ComponentType
from mavsdk.connection_result import ConnectionResult
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mocap import AngleBody, Covariance, Mocap, PositionBody, VisionPositionEstimate
from mavsdk.plugins.offboard import ActuatorControl, Attitude, Offboard

from companion.adapters.px4.direct import Px4Direct
from companion.adapters.px4.heard import LocalEstimate, Px4Heard
from companion.config import Px4Config
from companion.control.frames import euler_ned_frd_deg, flip_yz
from companion.ports import AutopilotError, Clock
from companion.types import Array, AttitudeThrust, AutopilotStatus, FlightMode

LOG = logging.getLogger(__name__)
_LOG_LEVELS = {LogLevel.DEBUG: logging.DEBUG, LogLevel.INFO: logging.DEBUG, LogLevel.WARN: logging.INFO}
"""One step quieter than MAVSDK thinks: what matters to the operator comes as an exception."""

_KEPT: list[Any] = []
"""C callbacks that MAVSDK may still call although it has forgotten them; a few bytes a command."""

_POLL_S = 0.02
_RETRY_S = 0.5
_WORDS_S = 0.5
_KILL_AGAIN_S = 0.1
_ADVICE = {
    ConnectionResult.BIND_ERROR: "is another program using that port?",
    ConnectionResult.CONNECTION_URL_INVALID: "not a MAVSDK URL such as udpin://0.0.0.0:14540 or serial:///dev/ttyUSB0:921600",
}
_ADVICE_ELSE = "is the device there, and may we use it?"


@asynccontextmanager
async def open_px4(config: Px4Config, clock: Clock) -> AsyncIterator["Px4"]:
    """Connect and yield the autopilot; AutopilotError when the port is taken or no PX4 is heard in time."""
    log_subscribe(_to_our_log)
    # As a ground station: PX4 sends its STATUSTEXTs (why it will not arm) only to links where one is heard.
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    mavsdk = Mavsdk(configuration)
    try:
        result = mavsdk.add_any_connection(config.url)
        if result != ConnectionResult.SUCCESS:
            raise AutopilotError(f"cannot open {config.url}: {_ADVICE.get(result, _ADVICE_ELSE)}")
        system = await _first_autopilot(mavsdk, config.connect_timeout_s)
        if system is None:
            raise AutopilotError(
                f"no autopilot heard on {config.url} within {config.connect_timeout_s:g} s: is PX4 (or the mock) "
                "running and sending MAVLink to this address?"
            )
        px4 = Px4(system, config, clock)
        try:
            await px4.see_modes_early()
            yield px4
        finally:
            px4.keep_callbacks()
    finally:
        mavsdk.destroy()
        configuration.destroy()


async def _first_autopilot(mavsdk: Mavsdk, timeout_s: float) -> Any:
    """The first autopilot heard, or None; nothing blocks, so that Ctrl-C need not wait for it."""
    loop = asyncio.get_running_loop()
    heard: asyncio.Future[Any] = loop.create_future()
    waiting = mavsdk.first_autopilot_async(timeout_s, lambda system: _deliver(loop, heard, system))
    try:
        return await heard
    finally:
        mavsdk.cancel_first_autopilot(waiting)


def _deliver(loop: asyncio.AbstractEventLoop, future: "asyncio.Future[Any]", value: Any) -> None:
    """From MAVSDK's thread into the event loop, if anybody still waits there."""

    def put() -> None:
        if not future.done():
            future.set_result(value)

    if not loop.is_closed():
        loop.call_soon_threadsafe(put)


Command = Callable[[Callable[[Any, Any], None]], None]
"""One of MAVSDK's `..._async` calls: takes a callback for its result."""


class Px4:
    """ports.Autopilot over MAVSDK."""

    def __init__(self, system: Any, config: Px4Config, clock: Clock) -> None:
        self._config, self._clock = config, clock
        self._offboard, self._action = Offboard(system), Action(system)
        self._mocap, self._direct = Mocap(system), Px4Direct(system)
        self._heard = Px4Heard(system, self._direct, clock)
        self.warnings: tuple[str, ...] = ()
        """What the operator should know of this autopilot's link."""

    def keep_callbacks(self) -> None:
        """Call before MAVSDK is destroyed: it forgets the callbacks of unanswered commands, but calls them."""
        for plugin in (self._offboard, self._action):
            _KEPT.extend(plugin._callbacks)
        _KEPT.extend(self._direct.kept_callbacks)

    async def see_modes_early(self) -> None:
        """Ask for the message that shows a change of mode within 50 ms; a warning when PX4 does not grant it."""
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()
        self._direct.ask_for_current_mode(lambda granted: _deliver(loop, answered, granted))
        try:
            async with asyncio.timeout(self._config.answer_timeout_s):
                granted = await answered
        except TimeoutError:
            granted = False
        if not granted:
            self.warnings = (
                "the autopilot does not send CURRENT_MODE faster (an older PX4?): a change of mode by the pilot or a "
                "failsafe is seen up to a second late",
            )

    def status(self) -> AutopilotStatus:
        """The last known state; never waits."""
        return self._heard.status

    def local(self) -> LocalEstimate:
        """Where the autopilot itself believes to be; never waits."""
        return self._heard.local

    async def params(self, names: Sequence[str]) -> dict[str, float]:
        """Values of PX4's parameters; those it does not know, or does not answer for, are absent."""
        return await self._direct.params(names)

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        """Send one attitude setpoint on the calling thread (0.1 ms)."""
        roll, pitch, yaw = euler_ned_frd_deg(setpoint.q_w_flu_wxyz)
        try:
            self._offboard.set_attitude(Attitude(roll, pitch, yaw, float(setpoint.thrust)))
        except MavsdkError as error:
            raise AutopilotError(f"setpoint not sent: {error}") from error

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
        self._offboard.set_actuator_control(ActuatorControl([]))

    async def start_offboard(self) -> None:
        """Ask for OFFBOARD and wait until the autopilot shows it; a setpoint must have been sent before."""
        since_s = self._clock.now_s()
        await self._call("start offboard mode", self._offboard.start_async, since_s)
        await self._shown("OFFBOARD mode", since_s, lambda: self._heard.mode_since(since_s) is FlightMode.OFFBOARD)

    async def arm(self) -> None:
        """Arm and wait until the HEARTBEAT shows it; asks again while PX4 says no, as it does while it warms up."""
        since_s = self._clock.now_s()
        await self._insist("arm", self._action.arm_async, since_s, self._config.arm_timeout_s)
        await self._shown("armed", since_s, lambda: self._heard.armed_since(since_s) is True)

    async def disarm(self) -> None:
        """Disarm and wait until shown; PX4 refuses in the air and for about a second after touchdown."""
        since_s = self._clock.now_s()
        await self._insist("disarm", self._action.disarm_async, since_s, self._config.answer_timeout_s)
        await self._shown("disarmed", since_s, lambda: self._heard.armed_since(since_s) is False)

    async def land(self) -> None:
        """Hand over to PX4's own landing and wait until OFFBOARD is left."""
        since_s = self._clock.now_s()
        await self._call("land", self._action.land_async, since_s)
        still = {None, FlightMode.OFFBOARD}
        await self._shown("leaving OFFBOARD", since_s, lambda: self._heard.mode_since(since_s) not in still)

    async def kill(self) -> None:
        """Stop the motors at once, also in the air: told again and again until the HEARTBEAT shows it."""
        since_s = self._clock.now_s()
        while self._heard.armed_since(since_s) is not False:
            self._direct.kill()
            if self._clock.now_s() - since_s > self._config.answer_timeout_s:
                raise AutopilotError("the autopilot was told to stop the motors but does not show it: look at the link")
            await asyncio.sleep(_KILL_AGAIN_S)

    async def _call(self, what: str, command: Command, since_s: float) -> None:
        """Give a command and wait for its answer without blocking a thread: a link may be silent for ever."""
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()
        command(lambda result, _: _deliver(loop, answered, result))
        try:
            async with asyncio.timeout(self._config.answer_timeout_s):
                result = await answered
        except TimeoutError as error:
            raise AutopilotError(f"the autopilot did not answer the command to {what}") from error
        if result.name != "SUCCESS":
            raise AutopilotError(f"the autopilot refused to {what}: {await self._reason(result.name, since_s)}")

    async def _insist(self, what: str, command: Command, since_s: float, timeout_s: float) -> None:
        while True:
            try:
                await self._call(what, command, since_s)
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
        """The autopilot's own words, which may come a little after its refusal; MAVSDK's if it gives none."""
        for _ in range(round(_WORDS_S / _POLL_S)):
            if self._heard.texts_since(since_s):
                break
            await asyncio.sleep(_POLL_S)
        words = list(dict.fromkeys(self._heard.texts_since(since_s)))
        return "; ".join(words) or result.lower().replace("_", " ")


def _to_our_log(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """MAVSDK prints every message to standard output unless somebody takes it."""
    LOG.log(_LOG_LEVELS.get(level, logging.INFO), "%s", message)
    return True
