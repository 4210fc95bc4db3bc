"""A mock autopilot on the bench: its MAVLink end without sockets, in simulated time.

Messages go in and come out as real MAVLink objects; only UDP and the wall clock are left out.
"""

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.config import LinkConfig, MockConfig
from mock_autopilot.faults.catalogue import Part
from mock_autopilot.mavlink.link import MavlinkLink
from mock_autopilot.mavlink.streams import TICK_S
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.world import STEP_S, World

NAN = math.nan
NO_GPS: dict[str, float] = {"EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 15, "EKF2_HGT_REF": 3, "EKF2_MAG_TYPE": 5}
LEVEL = (1.0, 0.0, 0.0, 0.0)
PERFECT: dict[str, Any] = {"attitude_error_rad": 0.0}
"""An estimator without errors: reports of modes, setpoints and the airframe shall not depend on a random draw."""
IMPERFECT: dict[str, Any] = {}
"""The product's own: horizon, position and height err as recorded from PX4, drawn with the seed."""
SIH_PLANT: dict[str, Any] = {
    "mass_kg": 1.0,
    "max_thrust_n": 20.0,
    "viscous_npm": (1.0, 1.0, 1.0),
    "quadratic_npm2": (0.0, 0.0, 0.0),
    "coulomb_n": (0.0, 0.0, 0.0),
}
"""The recorded simulator's quadrotor: 1 kg, 4 x 5 N, 1 N of drag per m/s (0.9 N, and less thrust, by the record's wall
clock: the simulator ran at 95 % of real time)."""

_UNANSWERED = frozenset({"SET_ATTITUDE_TARGET", "VISION_POSITION_ESTIMATE"})


@dataclass(frozen=True)
class Sent:
    """One message the autopilot sent, and when (simulated seconds after boot)."""

    time_s: float
    message: Any

    @property
    def type(self) -> str:
        """Return the message's name in MAVLink."""
        return str(self.message.get_type())


class OfflineLink(MavlinkLink):
    """The real link with its socket replaced by a list."""

    def __init__(self, world: World, config: LinkConfig | None = None) -> None:
        self.sent: list[Sent] = []
        self._clock = world
        super().__init__(config or LinkConfig.model_validate({}), world)

    @property
    def codec(self) -> Any:
        return self._codec

    def _packed(self, message: Any) -> Any:
        return message

    def take(self, message: Any) -> None:
        """Take a message that came without the wire's bytes."""
        self._receiver.handle(message)

    def _transmit(self, frame: Any) -> None:
        self.sent.append(Sent(self._clock.time_s, frame))


class Bench:
    """One vehicle, one client (245/190) that may stream setpoints, vision and heartbeats."""

    def __init__(
        self,
        params: Mapping[str, float] | None = None,
        plant: Mapping[str, Any] | None = None,
        gcs: bool = True,
        seed: int = 1,
        vehicle: Mapping[str, Any] | None = None,
        arms: Mapping[str, Any] | None = None,
        faults: Sequence[str] = (),
        estimator: Mapping[str, Any] = PERFECT,
        step_s: float = STEP_S,
    ) -> None:
        config = {
            "estimator": dict(estimator),
            "px4": {"params": dict(params or {})},
            "plant": dict(plant or {}),
            "vehicle": dict(vehicle or {}),
            "arms": dict(arms or {}),
            "faults": [{"say": sentence} for sentence in faults],
        }
        self._attach(World(MockConfig.from_dict(config), seed, step_s), gcs)

    @classmethod
    def of(cls, world: World) -> "Bench":
        """Attach to a vehicle of a fleet, which lets its time pass: `before_tick`, then the time, then `after_tick`."""
        bench = cls.__new__(cls)
        bench._attach(world, gcs=True)
        return bench

    def _attach(self, world: World, gcs: bool) -> None:
        self.world = world
        self.skips_wire = False
        """Setpoints and poses reach the autopilot as they are, without the wire's bytes: a tenth less to compute."""
        self.client_ended = False
        """Nothing that the client still says is heard: not what a service sends that was at work as it was stopped."""
        self.link = OfflineLink(world)
        self.system = int(world.vehicle.params["MAV_SYS_ID"])
        self.client = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
        self.heartbeats = gcs
        self.setpoint: Any = None
        self.setpoint_period_s = 0.02
        self.vision = False
        self.vision_offset_m = (0.0, 0.0, 0.0)
        self._ticks = 0

    def again(self) -> "Bench":
        """An independent copy of this flight so far; codecs and messages already sent are shared."""
        shared = [self.client, self.link.codec, *self.sent]
        return deepcopy(self, {id(item): item for item in shared})

    @property
    def now_s(self) -> float:
        return self.world.time_s

    @property
    def sent(self) -> list[Sent]:
        return self.link.sent

    # -- time ------------------------------------------------------------------------------------

    def run(self, for_s: float) -> None:
        """Advance simulated time, streaming setpoints and poses that are switched on."""
        for _ in range(round(for_s / TICK_S)):
            self.before_tick()
            self.world.advance(self._ticks * TICK_S)
            self.after_tick()

    def before_tick(self) -> None:
        """Send what the client streams."""
        self._stream()
        self._ticks += 1

    def after_tick(self) -> None:
        """Let the autopilot send what is due."""
        self.link.tell(self.world.vehicle.pop_texts())
        self.link.send_due()

    def run_until(self, to_s: float) -> None:
        self.run(to_s - self.now_s)

    def _every(self, period_s: float) -> bool:
        return self._ticks % round(period_s / TICK_S) == 0

    def _stream(self) -> None:
        if self.heartbeats and self._every(1.0):
            self.hear(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        if self.setpoint is not None and self._every(self.setpoint_period_s):
            self.hear(self.setpoint)
        if self.vision and self._every(0.02):
            self.see()

    # -- what the client says --------------------------------------------------------------------

    def hear(self, message: Any, system: int = 245) -> None:
        """Deliver one message to the autopilot, unless the client has ended."""
        if self.client_ended:
            return
        if self.skips_wire and message.get_type() in _UNANSWERED and not self.world.faults.active(Part.LINK):
            if self.world.vehicle.injected_faults.running:
                self.link.take(message)
            return
        self.client.srcSystem = system
        self.link.handle(bytes(message.pack(self.client)))

    def see(self) -> None:
        """One VISION_POSITION_ESTIMATE of the truth (plus the offset)."""
        truth = self.world.truth
        x, y, z = (truth.position_ned_m + self.vision_offset_m).tolist()
        roll, pitch, yaw = quat.to_euler(truth.q_ned_frd_wxyz)
        self.hear(mavlink.MAVLink_vision_position_estimate_message(0, x, y, z, roll, pitch, yaw, [NAN] * 21))

    def target(self, thrust: float, q: tuple[float, ...] = LEVEL, mask: int = 7, system: int | None = None) -> None:
        """Stream this attitude setpoint from now on; to this autopilot unless another system is named."""
        system = self.system if system is None else system
        self.setpoint = mavlink.MAVLink_set_attitude_target_message(0, system, 1, mask, list(q), 0.0, 0.0, 0.0, thrust)

    def command(self, command: int, *params: float, target: tuple[int, int] = (1, 1)) -> list[int]:
        """Send a COMMAND_LONG (missing parameters NaN, as MAVSDK does); results of the ACKs within 0.1 s."""
        before = len(self.sent)
        filled = [*params, *[NAN] * (7 - len(params))]
        self.hear(mavlink.MAVLink_command_long_message(*target, command, 0, *filled))
        self.run(0.1)
        return [
            s.message.result for s in self.sent[before:] if s.type == "COMMAND_ACK" and s.message.command == command
        ]

    def mode(self, main: int, sub: int = 0) -> list[int]:
        return self.command(176, 129.0 if self.world.vehicle.armed else 1.0, float(main), float(sub))

    def arm(self) -> list[int]:
        return self.command(400, 1.0)

    def fly_offboard(self, height_m: float = 3.0, thrust: float = 0.5) -> None:
        """Stream, OFFBOARD, arm, climb to about `height_m`, hover."""
        self.target(thrust)
        self.run(0.5)
        self.mode(6)
        self.arm()
        self.target(0.6)
        while -self.world.truth.position_ned_m[2] < height_m and self.now_s < 100.0:
            self.run(0.1)
        self.target(0.45)
        while self.world.truth.velocity_ned_mps[2] < 0.0:
            self.run(0.02)
        self.target(thrust)

    # -- what came back --------------------------------------------------------------------------

    def all(self, type_: str, since_s: float = 0.0) -> list[Sent]:
        return [s for s in self.sent if s.type == type_ and s.time_s >= since_s]

    def texts(self, since_s: float = 0.0) -> list[tuple[float, str]]:
        """Texts with their chunks joined, the closing tab cut off; without those of the logger."""
        out: list[tuple[float, str]] = []
        for s in self.all("STATUSTEXT", since_s):
            text = s.message.text if isinstance(s.message.text, str) else s.message.text.decode()
            if s.message.chunk_seq:
                out[-1] = (out[-1][0], out[-1][1] + text)
            else:
                out.append((s.time_s, text))
        return [(at, text.rstrip("\t")) for at, text in out if not text.startswith("[logger]")]

    def text_after(self, text: str, since_s: float) -> float:
        """Return the seconds from `since_s` to the first such text; infinite when there was none."""
        return next((at - since_s for at, said in self.texts(since_s) if text in said), math.inf)

    def heartbeat(self) -> tuple[int, int, int]:
        """Return base_mode, custom_mode and system_status as a HEARTBEAT would show them now."""
        vehicle = self.world.vehicle
        return (vehicle.base_mode, vehicle.mode.custom_mode, int(vehicle.system_status))
