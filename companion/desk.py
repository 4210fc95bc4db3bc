"""Where operators' commands are carried out: one flight command at a time, and what must not wait at once."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import asdict
from typing import Any

import numpy as np

from companion.bus import commands as asked
from companion.bus.commands import AT_ONCE, Command
from companion.bus.telemetry import Answer, Doing, Reply
from companion.config import CompanionConfig
from companion.control.reference import Hold
from companion.desk_plans import Laws, Planned, params_of, planned_arms, planned_track, yaw_here_rad
from companion.desk_words import first
from companion.orders import wanted_by
from companion.ports import CompanionError, FlightError
from companion.service_ends import disarmed, killed, resumed, stand_still, switched
from companion.service_space import check_climb
from companion.service_verbs import Service
from companion.supervisor.flight import IN_THE_AIR, Fly, Phase, Request, TakeOff

LOG = logging.getLogger(__name__)

_FLY = Fly(Hold(np.zeros(3)), 0.0)
"""Any: whether one fits depends on the phase alone."""
Say = Callable[[Reply], None]
"""Where the answers to one command go; must neither wait nor raise."""


def _nobody(_: str) -> None:
    """Nobody wants to know."""


class Job:
    """One command that is being carried out, and whoever waits for it."""

    def __init__(self, command: Command, say: Say) -> None:
        self.command, self._say = command, say
        self.accepted = False
        self.text = ""

    def accept(self, text: str = "") -> None:
        """It fits: from here on it can fail, but is not refused any more."""
        if not self.accepted:
            self.accepted = True
            self.answer(Answer.ACCEPTED, text)

    def progress(self, text: str) -> None:
        """Tell where it is."""
        self.text = text
        self.answer(Answer.PROGRESS, text)

    def answer(self, answer: Answer, text: str = "", data: dict[str, Any] | None = None) -> None:
        """Say it to whoever asked."""
        self._say(Reply(id=self.command.id, answer=answer, time_s=time.time(), text=text, data=data or {}))


class Desk:
    """Takes commands that count (bus.intake) and answers each: refused; or accepted, and later done or failed.

    Verbs of AT_ONCE are handed to the flight loop in the same turn, whatever else is under way: what they end is
    answered as failed. Of the others one for the flight and one for the arms run at a time.
    """

    def __init__(self, config: CompanionConfig, law: str) -> None:
        self._config, self._laws = config, Laws(config, law)
        self._service: Service | None = None
        self._jobs: dict[str, Job] = {}
        """By lane: flight, arms."""
        self._tasks: set[asyncio.Task[None]] = set()
        self.waiting = "the service begins"
        """Why nothing can be carried out now."""
        self.note_law: Callable[[str], None] = _nobody
        """Told the name of a law before it takes over."""

    def open(self, service: Service) -> None:
        """From now on commands are carried out."""
        self._service = service
        service.loop.law_name = self._laws.name

    async def close(self) -> None:
        """Nothing is carried out any more; what was, is answered as failed."""
        self._service, self.waiting = None, "it was lost, or the service ends"
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def doing(self) -> Doing | None:
        """The flight's command, or else the arms'."""
        job = self._jobs.get("flight") or self._jobs.get("arms")
        return None if job is None else Doing(id=job.command.id, verb=job.command.verb, text=job.text)

    def take(self, command: Command, say: Say) -> None:
        """Begin it, or refuse it; never waits."""
        job = Job(command, say)
        try:
            work = self._work(job)
        except CompanionError as error:
            self._refuse(job, str(error))
            return
        task = asyncio.get_running_loop().create_task(self._carry_out(job, work), name=f"companion.{command.verb}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _refuse(self, job: Job, reason: str) -> None:
        LOG.warning("%s (%s) is refused: %s", job.command.verb, job.command.id, reason)
        job.answer(Answer.REFUSED, reason)

    def _work(self, job: Job) -> Coroutine[Any, Any, "str | _Said"]:
        """What is to be awaited for it; CompanionError when it cannot begin. At-once verbs have begun then."""
        command, service = job.command, self._service
        if service is None:
            raise FlightError(f"there is no vehicle yet: {self.waiting}")
        if command.verb in AT_ONCE:
            return _AtOnce(service, job, self._config.px4.answer_timeout_s).begin()
        lane = _lane(command)
        if lane is not None:
            running = self._jobs.get(lane)
            if running is not None:
                raise FlightError(
                    f"{running.command.verb} ({running.command.id}) is still under way: wait, or say hold"
                )
            self._jobs[lane] = job
        return _Verbs(service, self._config, self._laws, job, self.note_law).run()

    async def _carry_out(self, job: Job, work: "Awaitable[str | _Said]") -> None:
        try:
            said = await work
            text, data = said if isinstance(said, tuple) else (said, {})
            job.accept()
            job.answer(Answer.DONE, text, data)
        except asyncio.CancelledError:
            job.answer(Answer.FAILED, "the service ends")
            raise
        except _NotGoodError as error:
            job.answer(Answer.FAILED, str(error), error.data)
        except CompanionError as error:
            self._end_badly(job, str(error))
        except Exception as error:
            LOG.exception("%s (%s) failed", job.command.verb, job.command.id)
            self._end_badly(job, f"{type(error).__name__}: {error}")
        finally:
            for lane in [lane for lane, running in self._jobs.items() if running is job]:
                del self._jobs[lane]

    def _end_badly(self, job: Job, reason: str) -> None:
        if not job.accepted:
            self._refuse(job, reason)
            return
        LOG.warning("%s (%s) failed: %s", job.command.verb, job.command.id, reason)
        job.answer(Answer.FAILED, reason)


_Said = tuple[str, dict[str, Any]]
"""A sentence, and what was asked for."""


class _NotGoodError(CompanionError):
    """What was asked for can be told, and is not good."""

    def __init__(self, reason: str, data: dict[str, Any]) -> None:
        super().__init__(reason)
        self.data = data


def _lane(command: Command) -> str | None:
    """Commands of one lane exclude each other."""
    if isinstance(command, asked.Arms):
        return None if command.do == "hold" else "arms"
    return None if isinstance(command, asked.Params) else "flight"


def _does_not_fit(what: str, refused: str, wanted: Request, service: Service) -> FlightError:
    """With what to say first, where the phase alone is in the way."""
    todo = first(wanted, service.phase) if refused.endswith(f"phase {service.phase}") else ""
    return FlightError(f"cannot {what}: {refused}{todo and f': {todo}'}")


class _AtOnce:
    """A verb of AT_ONCE: the request goes to the flight loop now, its end is awaited."""

    def __init__(self, service: Service, job: Job, answer_s: float) -> None:
        self._service, self._job, self._answer_s = service, job, answer_s

    def begin(self) -> Coroutine[Any, Any, str]:
        """Hand it in; FlightError with the reason when it does not fit."""
        command, service = self._job.command, self._service
        if isinstance(command, asked.Disarm):
            return self._disarm()
        wanted = wanted_by(command)
        assert wanted is not None
        refused = service.loop.refusal(wanted)
        down = service.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED}
        if refused and down and isinstance(command, asked.Land | asked.Abort):
            return self._on_ground()
        if refused or not service.loop.ask(wanted):
            raise _does_not_fit(command.verb, refused, wanted, service)
        self._job.accept()
        return self._end(command)

    async def _end(self, command: Command) -> str:
        service = self._service
        if isinstance(command, asked.Hold):
            await stand_still(service)
            return "it hovers"
        if isinstance(command, asked.Resume):
            await resumed(service, self._answer_s)
            return "we have the vehicle, it hovers"
        if isinstance(command, asked.Kill):
            await killed(service, self._answer_s)
            return "the motors are off"
        await service.land()
        return f"down and disarmed{f': {service.trouble}' if service.trouble else ''}"

    async def _on_ground(self) -> str:
        self._job.accept()
        return "it stands, nothing is under way"

    async def _disarm(self) -> str:
        service = self._service
        if service.phase in IN_THE_AIR and not service.loop.flight.touched_down:
            raise FlightError("cannot disarm: the vehicle is in the air; say land, or kill")
        self._job.accept()
        await disarmed(service, self._answer_s)
        return "the motors are off"


class _Verbs:
    """A verb that takes its time."""

    def __init__(
        self, service: Service, config: CompanionConfig, laws: Laws, job: Job, note_law: Callable[[str], None]
    ) -> None:
        self._service, self._config, self._laws, self._job = service, config, laws, job
        self._note_law = note_law

    def run(self) -> Coroutine[Any, Any, str | _Said]:
        """The coroutine that does it."""
        how: dict[type, Callable[[Any], Coroutine[Any, Any, str | _Said]]] = {
            asked.Preflight: self._preflight,
            asked.Arm: self._arm,
            asked.TakeOff: self._take_off,
            asked.GoTo: self._go_to,
            asked.Track: self._track,
            asked.Arms: self._arms,
            asked.SwitchController: self._controller,
            asked.Params: self._params,
        }
        return how[type(self._job.command)](self._job.command)

    def _fits(self, wanted: Request, what: str) -> None:
        refused = self._service.loop.refusal(wanted)
        if refused:
            raise _does_not_fit(what, refused, wanted, self._service)

    async def _preflight(self, _: asked.Preflight) -> _Said:
        self._job.accept("looking at motion capture, autopilot and arms")
        checks = await self._service.checks(None)
        data = {"checks": [asdict(check) for check in checks]}
        refused = sum(check.refuses for check in checks)
        if refused:
            raise _NotGoodError(f"{refused} of {len(checks)} checks fail: arming is refused", data)
        return f"{len(checks)} checks, it may arm", data

    async def _arm(self, _: asked.Arm) -> str:
        service = self._service
        await service.require_ground()
        self._job.accept("preparing")
        await service.ready()
        if self._config.arms is not None:
            self._job.progress("torque on, arms fold")
            await service.arms.prepare()
        self._job.progress("preflight checks, offboard mode, then arming")
        await service.arm()
        return "armed, the motors idle"

    async def _take_off(self, command: asked.TakeOff) -> str:
        height_m = command.height_m or self._config.flight.takeoff_height_m
        self._fits(TakeOff(height_m), "take off")
        vehicle = self._service.loop.estimate.vehicle
        check_climb(height_m, None if vehicle is None else vehicle.position_w_m, self._config)
        self._job.accept(f"climbing to {height_m:g} m")
        await self._service.take_off(height_m)
        return f"it hovers {height_m:g} m above where it stood"

    async def _go_to(self, command: asked.GoTo) -> str:
        service, place_w_m = self._service, np.array([command.x_m, command.y_m, command.z_m])
        self._fits(_FLY, "go there")
        yaw_rad = yaw_here_rad(service) if command.yaw_rad is None else command.yaw_rad
        await service.go_to(place_w_m, yaw_rad, self._job.accept)
        return f"it hovers at {command.x_m:g} {command.y_m:g} {command.z_m:g} m"

    async def _track(self, command: asked.Track) -> str:
        service = self._service
        self._fits(_FLY, "fly a trajectory")  # before anything is worked out
        plan: Planned = await planned_track(command, service, self._config)
        await service.fly(plan.trajectory, lambda: self._begin_track(plan))
        if plan.arms is not None:
            service.arms.still("the trajectory is over")
        return f"{plan.name} is flown, it hovers at its end"

    def _begin_track(self, plan: Planned) -> None:
        self._job.accept(f"to the start of {plan.name}, then {plan.trajectory.duration_s:.0f} s")
        if plan.arms is not None:
            self._service.arms.begin(plan.arms)

    async def _arms(self, command: asked.Arms) -> str:
        arms = self._service.arms
        if command.do == "hold":
            arms.still("the operator stopped them")
            return "the arms come to rest"
        if command.do == "play":
            motion = await planned_arms(command.motion or "", self._service, self._config)
            await arms.move(motion)
            self._job.accept(f"{command.motion} takes {motion.duration_s:.0f} s")
            await arms.at_rest(motion.duration_s)
            return f"{command.motion} is played"
        if command.do == "stow":
            await arms.fold(self._job.accept)
            return "the arms are folded"
        if command.do == "clear":
            self._job.accept()
            await arms.clear_faults()
            return "forgotten; say ready before they move again"
        await self._service.require_ground()
        self._job.accept()
        if command.do == "limp":
            await arms.limp()
            return "the arms are limp"
        await arms.prepare()
        return "the arms hold, folded"

    async def _controller(self, command: asked.SwitchController) -> str:
        before = self._service.loop.law_name
        law = await self._laws.load(command.name)
        self._note_law(command.name)
        self._job.accept(f"{before} hands over to {command.name}")
        self._service.loop.switch(law, command.name)
        self._laws.name = command.name
        await switched(self._service)
        return f"{command.name} flies"

    async def _params(self, _: asked.Params) -> _Said:
        self._job.accept()
        return "configuration, gains and the autopilot's parameters", await params_of(
            self._service, self._config, self._laws.name
        )
