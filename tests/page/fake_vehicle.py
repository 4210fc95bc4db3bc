"""A vehicle for the page's tests: a point that obeys commands at once and flies by arithmetic, without any clock."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from companion.arms.kinematics import points_flu_m
from companion.arms.model import ArmModel
from companion.core.types import Array
from companion.geometry.frames import quat_from_yaw

STEP_S = 0.1
"""Time between two states."""
_SPEED_MPS, _LAP_S, _PREFLIGHT_S = 1.0, 12.0, 0.6
_ARMS = ArmModel()
_STOW_RAD, _HOME_RAD = np.array([-0.47, 2.27, 0.0, 0.05] * 2), np.array([0.35, 0.7, 0.3, 0.8] * 2)
FENCE = {"x_m": [-4.5, 4.5], "y_m": [-4.5, 4.5], "top_m": 3.5}
CHECKS = (
    {"name": "disk", "passed": True, "says": "81 GB free", "todo": "", "must": True},
    {"name": "broker", "passed": True, "says": "answers within 2 ms", "todo": "", "must": True},
    {"name": "motion capture", "passed": True, "says": "100.0 Hz, delay 11 ms, noise 0.1 mm", "todo": "", "must": True},
    {"name": "autopilot link", "passed": True, "says": "heard 12 ms ago, PX4 1.17", "todo": "", "must": True},
    {"name": "attitudes", "passed": True, "says": "roll and pitch 0.3 degrees apart", "todo": "", "must": True},
    {"name": "headings", "passed": True, "says": "0.4 degrees apart", "todo": "", "must": True},
    {"name": "battery", "passed": True, "says": "92 %, 24.6 V", "todo": "", "must": True},
    {"name": "start place", "passed": True, "says": "3.1 m from the fence", "todo": "", "must": True},
    {"name": "arms", "passed": True, "says": "8 servos, 12.1 V, 31 degrees C", "todo": "", "must": True},
    {"name": "realtime priority", "passed": False, "says": "none", "todo": "set LimitRTPRIO=20", "must": False},
)


@dataclass
class FakeVehicle:
    """State of one vehicle; `step` advances it, `obey` gives it a command."""

    name: str
    position: Array
    phase: str = "standby"
    reason: str = ""
    armed: bool = False
    battery: float = 0.92
    controller: str = "practical"
    faults: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Active faults by name: text and reaction."""
    events: list[dict[str, Any]] = field(default_factory=list)
    """Events since they were taken last."""
    replies: list[dict[str, Any]] = field(default_factory=list)
    """Replies since they were taken last."""
    warnings: tuple[str, ...] = ()
    others: list[dict[str, Any]] = field(default_factory=list)
    joints: Array = field(default_factory=_STOW_RAD.copy)
    joints_goal: Array = field(default_factory=_STOW_RAD.copy)
    time_s: float = 0.0
    goal: Array | None = None
    job: dict[str, Any] | None = None
    job_text: str = ""
    job_s: float = 0.0
    lap_s: float | None = None
    velocity: Array = field(default_factory=lambda: np.zeros(3))

    def about(self) -> dict[str, Any]:
        """Return what the service says of itself once."""
        return {
            "vehicle": self.name, "body": self.name, "version": "0.1.0", "fence": FENCE,
            "room": {"x_m": [-4, 4], "y_m": [-4, 4], "z_m": [0.3, 3]}, "takeoff_height_m": 1.2, "footprint_m": 1.0,
            "controllers": ["practical", "paper", "paper-repaired", "pid"], "motions": ["reach", "swing", "tips"],
            "curves": ["ellipse", "figure8"], "arms": {"propellers": {"count": 4, "radius_m": 0.17, "centre_m": 0.33,
            "first_rad": 0.7854, "height_m": 0.06}}, "separation_order": [],
        }  # fmt: skip

    def presence(self) -> dict[str, Any]:
        """Return its presence on the broker."""
        return {"online": True, "session": "0" * 16, "vehicle": self.name, "host": "hexa", "version": "0.1.0"}

    def say(self, kind: str, text: str, **more: str) -> None:
        """Add an event."""
        self.events.append({"time_s": self.time_s, "kind": kind, "text": text, "name": "", "reaction": "", **more})

    def fail(self, name: str, text: str, reaction: str) -> None:
        """Make a fault active, and react as the service does."""
        self.faults[name] = (text, reaction)
        self.say("fault", text, name=name, reaction=reaction)
        if reaction in {"land", "hold", "PX4 lands"}:
            self.reason = text
            self.end("failed", text)
            self.enter({"land": "land", "hold": "hold"}.get(reaction, "handed over"))

    def recover(self, name: str) -> None:
        """End a fault."""
        text, _ = self.faults.pop(name)
        self.say("fault ends", text, name=name)

    def enter(self, phase: str) -> None:
        """Change the phase."""
        self.phase = phase
        self.goal = None if phase == "hold" else self.goal
        self.say("phase", f"{phase}: {self.reason}" if self.reason else phase, name=phase)

    def answer(self, answer: str, text: str = "", **data: Any) -> None:
        """Reply to the command that is under way."""
        if self.job is not None:
            self.replies.append(
                {"ref": self.job["ref"], "verb": self.job["verb"], "answer": answer, "text": text, "data": data}
            )

    def end(self, answer: str, text: str = "", **data: Any) -> None:
        """Reply for the last time to the command that is under way."""
        self.answer(answer, text, **data)
        self.job, self.job_text, self.lap_s = None, "", None

    def obey(self, command: dict[str, Any]) -> None:
        """Take a command of the page."""
        verb = command["verb"]
        refusal = self._refusal(verb)
        if refusal:
            self.replies.append({"ref": command["ref"], "verb": verb, "answer": "refused", "text": refusal, "data": {}})
            return
        self.end("failed", f"ended by {verb}")
        self.job, self.job_s = command, 0.0
        self.say("command", f"{verb} by the page", name=verb)
        getattr(self, f"_begin_{verb}")(command)

    def _refusal(self, verb: str) -> str:
        flies = self.phase in {"takeoff", "hold", "track", "land"}
        if verb == "arm" and flies:
            return "the vehicle is in the air; run `companion land` first"
        if verb == "takeoff" and self.phase != "armed":
            return "the vehicle is disarmed; run `companion arm` first" if not flies else "the vehicle is in the air"
        if verb in {"goto", "track", "hold", "land"} and not flies:
            return "the vehicle is on the ground; run `companion takeoff` first"
        if verb == "resume" and self.phase != "handed over":
            return "this service has the vehicle; there is nothing to take back"
        return ""

    def _accept(self, text: str) -> None:
        self.job_text = text
        self.answer("accepted", text)

    def _begin_preflight(self, _: dict[str, Any]) -> None:
        self._accept("looking at motion capture, autopilot and arms")

    def _begin_arm(self, _: dict[str, Any]) -> None:
        self._accept("preparing")
        self.enter("preflight")

    def _begin_takeoff(self, command: dict[str, Any]) -> None:
        height = command.get("height_m", 1.2)
        self._accept(f"climbing to {height:g} m")
        self.goal = self.position + np.array([0.0, 0.0, height])
        self.enter("takeoff")

    def _begin_goto(self, command: dict[str, Any]) -> None:
        self._accept("")
        self.enter("hold")
        self.goal = np.array([command["x_m"], command["y_m"], command["z_m"]])

    def _begin_track(self, command: dict[str, Any]) -> None:
        self._accept(f"to the start of {command['curve']}, then {command.get('laps', 2) * _LAP_S:.0f} s")
        self.lap_s = 0.0
        self.enter("track")

    def _begin_hold(self, _: dict[str, Any]) -> None:
        self._accept("")
        self.enter("hold")
        self.end("done", "it hovers")

    def _begin_land(self, _: dict[str, Any]) -> None:
        self._accept("")
        self.enter("land")

    def _begin_abort(self, command: dict[str, Any]) -> None:
        self.reason = "the operator aborted"
        if self.phase in {"standby", "armed", "disarmed"}:
            self._accept("")
            self._ground()
        else:
            self._begin_land(command)

    def _begin_disarm(self, _: dict[str, Any]) -> None:
        self._accept("")
        self._ground()

    def _begin_controller(self, command: dict[str, Any]) -> None:
        self._accept(f"{self.controller} hands over to {command['name']}")
        self.controller = command["name"]
        self.end("done", f"{self.controller} flies")

    def _begin_arms(self, command: dict[str, Any]) -> None:
        self._accept("")
        self.joints_goal = _HOME_RAD if command["do"] == "play" else _STOW_RAD
        self.end("done", f"{command.get('motion', 'the arms')}: done")

    def _begin_kill(self, _: dict[str, Any]) -> None:
        self.reason, self.armed = "the operator killed", False
        self.enter("terminated")
        self.end("done", "the motors stand")

    def _ground(self) -> None:
        self.armed, self.goal = False, None
        self.enter("disarmed")
        self.end("done", "disarmed")

    def step(self) -> None:
        """Advance by STEP_S."""
        self.time_s += STEP_S
        self.job_s += STEP_S
        before = self.position.copy()
        self.joints = self.joints + 0.15 * (self.joints_goal - self.joints)
        self._work()
        self.velocity = (self.position - before) / STEP_S

    def _work(self) -> None:
        verb = self.job["verb"] if self.job else ""
        if verb in {"preflight", "arm"}:
            self._prepare(verb)
        elif self.phase in {"takeoff", "hold"} and self.goal is not None:
            if self._approach(self.goal):
                self.goal = None
                if self.phase == "takeoff":
                    self.enter("hold")
                self.end("done", "it hovers there")
        elif self.phase == "track":
            self._fly()
        elif self.phase in {"land", "handed over"} and self._approach(np.array([*self.position[:2], 0.0])):
            self._ground()

    def _prepare(self, verb: str) -> None:
        shown = CHECKS[: int(len(CHECKS) * self.job_s / _PREFLIGHT_S)]
        self.answer("progress", "checks", **({"checks": list(shown)} if verb == "preflight" else {}))
        if self.job_s < _PREFLIGHT_S:
            return
        if verb == "arm":
            self.armed = True
            self.enter("armed")
            self.end("done", "armed, the motors idle")
        else:
            self.end("done", "it may arm, 1 warning", checks=list(CHECKS))

    def _approach(self, goal: Array) -> bool:
        away = goal - self.position
        distance = float(np.linalg.norm(away))
        step = min(distance, _SPEED_MPS * STEP_S)
        self.position = self.position + (away * step / distance if distance else 0.0)
        return distance <= step

    def _fly(self) -> None:
        assert self.lap_s is not None
        self.lap_s += STEP_S
        angle = 2.0 * math.pi * self.lap_s / _LAP_S
        centre = np.array([0.0, 0.0, max(self.position[2], 1.2)])
        self._approach(centre + np.array([1.4 * math.cos(angle), 0.9 * math.sin(angle), 0.0]))
        self.position[2] = 1.2 + 0.15 * math.sin(0.5 * angle)
        if self.job and self.lap_s >= self.job.get("laps", 2) * _LAP_S:
            self.enter("hold")
            self.end("done", "ellipse is flown, it hovers at its end")

    def state(self) -> dict[str, Any]:
        """Return the state as the service publishes it."""
        flies = self.phase in {"takeoff", "hold", "track", "land"}
        yaw = 0.3 * math.sin(0.2 * self.time_s)
        error = 0.012 + 0.006 * math.sin(1.7 * self.time_s) + 0.05 * float(np.linalg.norm(self.velocity)) ** 2
        lean = quat_from_yaw(yaw) + np.array([0.0, -0.08 * self.velocity[1], 0.08 * self.velocity[0], 0.0])
        still = None if self.lap_s is None or self.job is None else self.job.get("laps", 2) * _LAP_S - self.lap_s
        return {
            "time_s": self.time_s, "session": "0" * 16, "phase": self.phase, "reason": self.reason, "armed": self.armed,
            "in_air": flies, "mode": "OFFBOARD" if self.armed else "HOLD", "battery": self.battery, "battery_v": 24.1,
            "position_w_m": self.position.tolist(), "velocity_w_mps": self.velocity.tolist(), "yaw_rad": yaw,
            "q_w_flu_wxyz": (lean / np.linalg.norm(lean)).tolist(), "tilt_rad": 0.02,
            "age_s": 0.011 + 0.003 * math.sin(self.time_s), "px4_age_s": 0.02,
            "reference_w_m": (self.position + np.array([error, 0.0, 0.01])).tolist() if flies else None,
            "error_m": error if flies else None, "thrust": 0.5 if flies else None, "controller": self.controller,
            "sent_share": 0.31 + 0.12 * math.sin(0.9 * self.time_s) if flies else None, "law_link": None,
            "faults": list(self.faults), "arms": "hold", "joints_rad": self.joints.tolist(),
            "doing": {"id": "page-1", "verb": self.job["verb"], "text": self.job_text} if self.job else None,
            "remaining_s": still, "late_s": 0.0004, "text": "", "text_age_s": None, "warnings": list(self.warnings),
            "record": "2026-06-11T14-02-55.mcap" if self.armed else "", "others": self.others,
        }  # fmt: skip

    def arms_b_m(self) -> dict[str, Any]:
        """Return the points of both arms in body FLU."""
        right, left = points_flu_m(_ARMS, self.joints).tolist()
        return {"right": right, "left": left}
