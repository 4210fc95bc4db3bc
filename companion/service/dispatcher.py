"""Execution of operators' commands: queued ones one at a time for each channel, immediate ones at once."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import CompanionError, FlightError
from companion.core.types import AutopilotStatus
from companion.protocol import commands
from companion.protocol.commands import AT_ONCE, Command
from companion.protocol.telemetry import Answer, Doing
from companion.service.command_job import CHANNELS, CommandJob, SendReply, channels_of
from companion.service.completion import (
    cancel_preparation,
    disarm_and_wait,
    wait_until_hovering,
    wait_until_killed,
    wait_until_resumed,
    watch_after_switch,
)
from companion.service.flight_actions import FlightActions
from companion.service.orders import request_of
from companion.service.planning import Laws, Planned, params_of, planned_arms, planned_track, yaw_here_rad
from companion.service.refusal_hints import remedy_for
from companion.service.trajectory_space import check_climb
from companion.supervisor.flight_state import (
    IN_THE_AIR,
    STREAMING,
    FlightState,
    HoldRequest,
    Phase,
    Request,
    TakeoffRequest,
    TrackRequest,
)
from companion.trajectories.reference import Hold

LOG = logging.getLogger(__name__)

_VERB_WORDS = {"arm": "arm", "takeoff": "take off"}
_ANY_TRACK = TrackRequest(Hold(np.zeros(3)), 0.0)
"""Any trajectory: whether one may be flown depends on the phase alone."""


def _ignore_law(_: str) -> None:
    """Ignore the name of the law."""


def _no_rival() -> str:
    """Return no conflict with another service."""
    return ""


class CommandDispatcher:
    """Executor of validated commands; replies to each: refused, or accepted and later done or failed.

    Verbs of AT_ONCE reach the flight loop in the same turn of the event loop, whatever else is under way. Commands that
    they end, or that are still being prepared, are answered as failed: nothing sent before them starts after them. Of
    the others, one for the flight and one for the arms run at a time.
    """

    def __init__(self, config: CompanionConfig, law: str) -> None:
        self._config, self._laws = config, Laws(config, law)
        self._service: FlightActions | None = None
        self._jobs: dict[str, CommandJob] = {}
        """Commands under way by channel: flight, arms."""
        self._tasks: dict[asyncio.Task[None], CommandJob] = {}
        self.waiting = "the service starts"
        """Reason why no command can be carried out now."""
        self.note_law: Callable[[str], None] = _ignore_law
        """Called with the name of a law before that law takes over."""
        self.rival: Callable[[], str] = _no_rival
        """Returns the conflict when another service uses this vehicle's name; arming is refused then."""

    def open(self, service: FlightActions) -> None:
        """Accept commands for this vehicle; it flies the law that the service was started with."""
        self._service = service
        service.loop.law_name = self._laws.name

    async def close(self) -> None:
        """Stop accepting commands; those under way are answered as failed."""
        self._service, self.waiting = None, "the connection to it was lost, or the service ends"
        for job in self._tasks.values():
            job.call_off(self.waiting)
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def ticking(self) -> bool:
        """True while a flight loop runs and ticks by itself."""
        return self._service is not None and self._service.loop.ticking

    @property
    def ended_loop(self) -> tuple[FlightState, AutopilotStatus] | None:
        """Flight and autopilot status after the loop has failed and handed over without further ticks; else None."""
        service = self._service
        if service is None or not service.loop.failed:
            return None
        return service.loop.flight, service.status

    @property
    def doing(self) -> Doing | None:
        """Command of the flight that is under way, or else that of the arms; None when there is neither."""
        job = self._jobs.get("flight") or self._jobs.get("arms")
        return None if job is None else Doing(id=job.command.id, verb=job.command.verb, text=job.text)

    def take(self, command: Command, send_reply: SendReply) -> None:
        """Start a command or refuse it, without waiting."""
        job = CommandJob(command, send_reply)
        try:
            work = self._work(job)
        except CompanionError as error:
            self._refuse(job, str(error))
            return
        task = asyncio.get_running_loop().create_task(self._carry_out(job, work), name=f"companion.{command.verb}")
        self._tasks[task] = job
        task.add_done_callback(self._tasks.pop)

    def _refuse(self, job: CommandJob, reason: str) -> None:
        LOG.warning("%s (%s) is refused: %s", job.command.verb, job.command.id, reason)
        job.answer(Answer.REFUSED, reason)

    def _work(self, job: CommandJob) -> Coroutine[Any, Any, "str | _Result"]:
        """Return the coroutine that carries it out, or raise CompanionError. Immediate verbs have started by then."""
        command, service = job.command, self._service
        if service is None:
            raise FlightError(f"cannot {command.verb}: there is no vehicle yet: {self.waiting}")
        if command.verb in AT_ONCE:
            work = ImmediateCommands(service, job, self._config.px4.answer_timeout_s).begin()
            if not isinstance(command, commands.Resume):
                self._call_off(CHANNELS, f"{command.verb} was ordered")
            return work
        if isinstance(command, commands.Arm | commands.TakeOff) and self.rival():
            raise FlightError(f"cannot {_VERB_WORDS[command.verb]}: {self.rival()}")
        channels = channels_of(command)
        for channel in channels:
            running = self._jobs.get(channel)
            if running is not None:
                raise FlightError(
                    f"{running.command.verb} ({running.command.id}) is still under way: wait, or run `companion hold`"
                )
        self._jobs |= dict.fromkeys(channels, job)
        if isinstance(command, commands.Arms) and command.do == "hold":
            self._call_off(("arms",), "a hold of the arms was commanded")
        return QueuedCommands(service, self._config, self._laws, job, self.note_law).run()

    def _call_off(self, channels: Iterable[str], why: str) -> None:
        """Cancel commands in preparation; those that have started are ended by the flight or by the arms."""
        for channel in channels:
            job = self._jobs.get(channel)
            if job is not None and job.preparing:
                job.call_off(why)

    async def _carry_out(self, job: CommandJob, work: "Coroutine[Any, Any, str | _Result]") -> None:
        job.begin()
        try:
            if job.called_off:
                work.close()
                self._fail(job, job.called_off)
                return
            result = await work
            text, data = result if isinstance(result, tuple) else (result, {})
            job.accept()
            job.answer(Answer.DONE, text, data)
        except asyncio.CancelledError:
            self._fail(job, job.called_off or "the service ends")
            if not job.called_off:
                raise
        except _NegativeResultError as error:
            job.answer(Answer.FAILED, str(error), error.data)
        except CompanionError as error:
            self._fail(job, str(error))
        except Exception as error:
            LOG.exception("%s (%s) failed", job.command.verb, job.command.id)
            self._fail(job, f"{type(error).__name__}: {error}")
        finally:
            for channel in [channel for channel, running in self._jobs.items() if running is job]:
                del self._jobs[channel]

    def _fail(self, job: CommandJob, reason: str) -> None:
        if not job.accepted:
            self._refuse(job, reason)
            return
        LOG.warning("%s (%s) failed: %s", job.command.verb, job.command.id, reason)
        job.answer(Answer.FAILED, reason)


_Result = tuple[str, dict[str, Any]]
"""A sentence for the operator, and the data that was requested."""


class _NegativeResultError(CompanionError):
    """A negative result that still has data to return."""

    def __init__(self, reason: str, data: dict[str, Any]) -> None:
        super().__init__(reason)
        self.data = data


def _refusal(what: str, refused: str, request: Request, service: FlightActions) -> FlightError:
    """Return the refusal as an error, with the remedy where the phase is the only reason."""
    remedy = remedy_for(request, service.phase) if refused.endswith(f"phase {service.phase}") else ""
    return FlightError(f"cannot {what} in phase {service.phase}: {remedy}" if remedy else f"cannot {what}: {refused}")


class ImmediateCommands:
    """Commands of AT_ONCE: the request goes to the flight loop at once, its end is awaited."""

    def __init__(self, service: FlightActions, job: CommandJob, answer_s: float) -> None:
        self._service, self._job, self._answer_s = service, job, answer_s

    def begin(self) -> Coroutine[Any, Any, str]:
        """Pass the request to the flight loop and return the wait for its end; raise FlightError when it is refused."""
        command, service = self._job.command, self._service
        if isinstance(command, commands.Disarm):
            return self._disarm()
        request = request_of(command)
        assert request is not None
        refused = service.loop.refusal(request)
        down = service.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED}
        if down and isinstance(command, commands.Land | commands.Abort):
            if refused:
                return self._on_ground()
            self._job.accept()
            service.loop.ask(request)
            cancel_preparation(service, f"{command.verb} was ordered")
            return _reply_now("it stands, and what was being prepared has ended")
        if refused or not service.loop.ask(request):
            raise _refusal(command.verb, refused, request, service)
        self._job.accept()
        if not isinstance(command, commands.Hold | commands.Resume):
            cancel_preparation(service, f"{command.verb} was ordered")
        return self._end(command)

    async def _end(self, command: Command) -> str:
        service = self._service
        if isinstance(command, commands.Hold):
            await wait_until_hovering(service)
            return "it hovers"
        if isinstance(command, commands.Resume):
            await wait_until_resumed(service, self._answer_s)
            return "we have the vehicle, it hovers"
        if isinstance(command, commands.Kill):
            await wait_until_killed(service, self._answer_s)
            return "the motors are off"
        await service.land()
        return f"down and disarmed{f': {service.trouble}' if service.trouble else ''}"

    def _on_ground(self) -> Coroutine[Any, Any, str]:
        service, verb = self._service, self._job.command.verb
        if service.status.armed or service.status.in_air:
            raise FlightError(
                f"cannot {verb}: this service does not fly the vehicle, and the autopilot says that it is "
                f"{'in the air' if service.status.in_air else 'armed'}: use the remote control, or run `companion kill`"
            )
        self._job.accept()
        cancel_preparation(service, f"{verb} was ordered")
        return _reply_now("it stands, nothing is under way")

    def _disarm(self) -> Coroutine[Any, Any, str]:
        service, phase = self._service, self._service.phase
        flying = phase in IN_THE_AIR and not service.loop.flight.touched_down
        if flying or (phase not in STREAMING and service.status.in_air):
            raise FlightError("cannot disarm: the vehicle is in the air; run `companion land`, or `companion kill`")
        self._job.accept()
        return self._disarmed()

    async def _disarmed(self) -> str:
        await disarm_and_wait(self._service, self._answer_s)
        return "the motors are off"


async def _reply_now(text: str) -> str:
    """Return a reply that needs no waiting."""
    return text


class QueuedCommands:
    """Commands that take time and wait for their channel."""

    def __init__(
        self,
        service: FlightActions,
        config: CompanionConfig,
        laws: Laws,
        job: CommandJob,
        note_law: Callable[[str], None],
    ) -> None:
        self._service, self._config, self._laws, self._job = service, config, laws, job
        self._note_law = note_law

    def run(self) -> Coroutine[Any, Any, str | _Result]:
        """Return the coroutine that carries out the command."""
        handlers: dict[type, Callable[[Any], Coroutine[Any, Any, str | _Result]]] = {
            commands.Preflight: self._preflight,
            commands.Arm: self._arm,
            commands.TakeOff: self._take_off,
            commands.GoTo: self._go_to,
            commands.Track: self._track,
            commands.Arms: self._arms,
            commands.SwitchController: self._controller,
            commands.Params: self._params,
        }
        return handlers[type(self._job.command)](self._job.command)

    def _start(self, text: str = "") -> None:
        """Accept the command and end its preparation: from here on the flight, or the arms, end it."""
        self._job.preparing = False
        self._job.accept(text)

    def _require_allowed(self, request: Request, what: str) -> None:
        refused = self._service.loop.refusal(request)
        if refused:
            raise _refusal(what, refused, request, self._service)

    async def _preflight(self, _: commands.Preflight) -> _Result:
        self._job.preparing = False
        self._job.accept("looking at motion capture, autopilot and arms")
        with self._service.report_waits_to(self._job.progress):
            checks = await self._service.checks(None)
        data = {"checks": [asdict(check) for check in checks]}
        refused = sum(check.refuses for check in checks)
        if refused:
            raise _NegativeResultError(f"{refused} of {len(checks)} checks fail: arming is refused", data)
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
        with service.report_waits_to(self._job.progress):
            await service.arm()
        return "armed, the motors idle"

    async def _take_off(self, command: commands.TakeOff) -> str:
        height_m = command.height_m or self._config.flight.takeoff_height_m
        self._require_allowed(TakeoffRequest(height_m), "take off")
        vehicle = self._service.loop.estimate.vehicle
        check_climb(height_m, None if vehicle is None else vehicle.position_w_m, self._config)
        self._start(f"climbing to {height_m:g} m")
        await self._service.take_off(height_m)
        return f"it hovers {height_m:g} m above where it stood"

    async def _go_to(self, command: commands.GoTo) -> str:
        service, target_w_m = self._service, np.array([command.x_m, command.y_m, command.z_m])
        self._require_allowed(_ANY_TRACK, "go there")
        yaw_rad = yaw_here_rad(service) if command.yaw_rad is None else command.yaw_rad
        await service.go_to(target_w_m, yaw_rad, self._start)
        return f"it hovers at {command.x_m:g} {command.y_m:g} {command.z_m:g} m"

    async def _track(self, command: commands.Track) -> str:
        service = self._service
        self._require_allowed(_ANY_TRACK, "fly a trajectory")  # before anything is worked out
        plan: Planned = await planned_track(command, service, self._config)
        try:
            await service.fly(plan.trajectory, lambda: self._begin_track(plan))
        finally:
            if plan.arms is not None:
                service.arms.end(plan.arms, "the trajectory is over")
        return f"{plan.name} is flown, it hovers at its end"

    def _begin_track(self, plan: Planned) -> None:
        self._start(f"to the start of {plan.name}, then {plan.trajectory.duration_s:.0f} s")
        if plan.arms is None:
            return
        try:
            self._service.arms.begin(plan.arms)
        except CompanionError:
            self._service.loop.ask(HoldRequest())
            raise

    async def _arms(self, command: commands.Arms) -> str:
        arms = self._service.arms
        if command.do == "hold":
            arms.still("the operator stopped them")
            return "the arms come to rest"
        if command.do == "play":
            motion = await planned_arms(command.motion or "", self._service, self._config)
            await arms.move(motion)
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
        before = self._service.loop.law_name
        law = await self._laws.load(command.name)
        self._note_law(command.name)
        self._start(f"{before} hands over to {command.name}")
        self._service.loop.switch(law, command.name)
        await watch_after_switch(self._service)
        return f"{command.name} {'flies' if self._service.loop.flight.airborne else 'is to fly'}"

    async def _params(self, _: commands.Params) -> _Result:
        self._job.accept()
        return "configuration, gains and the autopilot's parameters", await params_of(
            self._service, self._config, self._service.loop.law_name
        )
