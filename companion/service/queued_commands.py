"""Commands that take time: one at a time for the flight, and one for the arms."""

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from dataclasses import asdict
from typing import Any

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_path
from companion.config.preflight_config import load_recommended
from companion.config.toml_files import read_toml
from companion.core.interfaces import CompanionError, FlightError
from companion.law_link.vehicle_end import VehicleEnd
from companion.protocol import commands
from companion.service.command_job import CommandJob
from companion.service.flight_actions import FlightActions, ended_by
from companion.service.planning import Planned, load_law, planned_arms, planned_track, yaw_here_rad
from companion.service.traffic import Traffic, Way
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import HoldRequest, TrackRequest
from companion.trajectories.reference import Hold

_ANY_TRACK = TrackRequest(Hold(np.zeros(3)), 0.0)
"""Any trajectory: without other vehicles in its way, whether one may be flown depends on the phase alone."""
_WATCHED_S = 3.0
"""Time a flight is observed after a change of law before the change counts as done: oscillation shows by then."""
_GROUND_ANSWERS_S = 7.5
"""Below the 8 s within which a command is answered."""

Result = tuple[str, dict[str, Any]]
"""A sentence for the operator, and the data that was requested."""


class NegativeResultError(CompanionError):
    """A negative result that still has data to return."""

    def __init__(self, reason: str, data: dict[str, Any]) -> None:
        super().__init__(reason)
        self.data = data


class QueuedCommands:
    """One command that takes time and excludes others of its channels."""

    def __init__(
        self,
        service: FlightActions,
        config: CompanionConfig,
        job: CommandJob,
        note_law: Callable[[str], None],
        traffic: Traffic,
    ) -> None:
        self._service, self._config, self._job, self._note_law = service, config, job, note_law
        self._traffic = traffic

    def run(self) -> Coroutine[Any, Any, str | Result]:
        """Return the coroutine that carries out the command."""
        handlers: dict[str, Callable[[Any], Coroutine[Any, Any, str | Result]]] = {
            "preflight": self._preflight,
            "arm": self._arm,
            "takeoff": self._take_off,
            "goto": self._go_to,
            "track": self._track,
            "arms": self._arms,
            "controller": self._controller,
            "params": self._params,
        }
        return handlers[self._job.command.verb](self._job.command)

    def _start(self, text: str = "") -> None:
        """Accept the command and end its preparation: from here on the flight, or the arms, end it."""
        self._job.preparing = False
        self._job.accept(text)

    async def _preflight(self, _: commands.Preflight) -> Result:
        self._start("looking at motion capture, autopilot and arms")
        checks = await self._service.reports.checks(self._job.progress)
        data = {"checks": [asdict(check) for check in checks]}
        refused = sum(check.refuses for check in checks)
        if refused:
            raise NegativeResultError(f"{refused} of {len(checks)} checks fail: arming is refused", data)
        warned = sum(not check.passed for check in checks)
        warnings = f", {warned} warning{'s' if warned > 1 else ''}" if warned else ""
        return f"it may arm{warnings}", data

    async def _arm(self, _: commands.Arm) -> str:
        service = self._service
        await service.require_ground()
        self._job.accept("preparing")
        await service.ready()
        if self._config.arms is not None:
            self._job.progress("torque on, arms fold")
            await service.arms.prepare()
        self._job.progress("preflight checks, offboard mode, then arming")
        self._job.preparing = False
        await service.arm(self._job.progress)
        return "armed, the motors idle"

    async def _take_off(self, command: commands.TakeOff) -> str:
        height_m = command.height_m or self._config.flight.takeoff_height_m
        await self._service.take_off(height_m, lambda: self._start(f"climbing to {height_m:g} m"))
        return f"it hovers {height_m:g} m above where it stood"

    async def _go_to(self, command: commands.GoTo) -> str:
        service, target_w_m = self._service, np.array([command.x_m, command.y_m, command.z_m])
        yaw_rad = yaw_here_rad(service) if command.yaw_rad is None else command.yaw_rad
        way = await self._traffic.way(service.loop, TrackRequest(Hold(target_w_m, yaw_rad), 0.0))
        try:
            await service.go_to(target_w_m, yaw_rad, lambda: self._begin_way(way, ""))
        finally:
            self._traffic.end(way)
        return f"it hovers at {command.x_m:g} {command.y_m:g} {command.z_m:g} m"

    async def _track(self, command: commands.Track) -> str:
        service = self._service
        rejection = service.loop.refusal(_ANY_TRACK) if not self._config.separation.order else ""
        if rejection:  # before seconds of planning; what may change meanwhile is evaluated at the start
            raise FlightError(rejection)
        plan: Planned = await asyncio.to_thread(planned_track, command, service, self._config.arms)
        way = await self._traffic.way(service.loop, TrackRequest(plan.trajectory, self._config.flight.settle_s))
        try:
            await service.fly(plan.trajectory, lambda: self._begin_track(plan, way))
        finally:
            self._traffic.end(way)
            if plan.arms is not None:
                service.arms.end(plan.arms, "the trajectory is over")
        return f"{plan.name} is flown, it hovers at its end"

    def _begin_way(self, way: Way, text: str) -> None:
        self._traffic.begin(self._job.command.verb, way)
        self._start("; ".join(filter(None, (text, way.note))))

    def _begin_track(self, plan: Planned, way: Way) -> None:
        self._begin_way(way, f"to the start of {plan.name}, then {plan.trajectory.duration_s:.0f} s")
        if plan.arms is None:
            return
        try:
            self._service.arms.begin(plan.arms)
        except CompanionError:
            self._service.loop.submit(HoldRequest())
            raise

    async def _arms(self, command: commands.Arms) -> str:
        arms = self._service.arms
        if command.do == "hold":
            arms.still("the operator stopped them")
            return "the arms come to rest"
        if command.do == "play":
            motion = await asyncio.to_thread(planned_arms, command.motion or "", self._service, self._config.arms)
            arms.begin(motion)
            self._start(f"{command.motion} takes {motion.duration_s:.0f} s")
            await arms.at_rest(motion.duration_s)
            return f"{command.motion} is played"
        if command.do == "stow":
            await arms.fold(self._start)
            return "the arms are folded"
        if command.do == "clear":
            self._start()
            await arms.clear_faults()
            return "forgotten; run `companion arms live ready` before they move again"
        await self._service.require_ground()
        self._job.accept()
        if command.do == "limp":
            self._job.preparing = False
            await arms.limp()
            return "the arms are limp"
        await arms.prepare()
        return "the arms hold, folded"

    async def _controller(self, command: commands.SwitchController) -> str:
        service, before = self._service, self._service.loop.law_name
        if service.loop.remote is not None:
            await self._switch_on_ground(service.loop.remote.end, command.name)
            self._start(f"{before} has handed over to {command.name}")
        else:
            law = await asyncio.to_thread(load_law, command.name, self._config)
            self._note_law(command.name)
            self._start(f"{before} hands over to {command.name}")
            service.loop.switch(law, command.name)
        if service.loop.flight.airborne:
            await service.until(lambda: not service.loop.flight.airborne, _WATCHED_S)
            if not service.loop.flight.airborne or service.loop.flight.level >= FailsafeAction.LAND:
                raise FlightError(ended_by(service.loop.flight))
        return f"{command.name} {'flies' if service.loop.flight.airborne else 'is to fly'}"

    async def _switch_on_ground(self, end: VehicleEnd, name: str) -> None:
        """Have the ground load, judge and fly another law; FlightError with its reason if it does not."""
        end.ask(json.dumps({"controller": name}), time.monotonic())
        answered = await self._service.until(lambda: bool(end.answers), _GROUND_ANSWERS_S)
        end.stop_asking()
        if not answered:
            raise FlightError(f"the ground law has not answered within {_GROUND_ANSWERS_S:g} s")
        answer = json.loads(end.answers.pop())
        if "refused" in answer:
            raise FlightError(answer["refused"])
        end.rename(name)

    async def _params(self, _: commands.Params) -> Result:
        self._job.accept()
        law, names = self._service.loop.law_name, sorted(load_recommended(self._config.preflight.parameters))
        return "configuration, gains and the autopilot's parameters", {
            "config": self._config.model_dump(mode="json"),
            "controller": {
                "name": law,
                **(read_toml(controller_path(law)) if self._service.loop.remote is None else {}),
            },
            "px4": await self._service.reports.params(names),
        }
