"""Execution of operators' commands: queued ones one at a time for each channel, immediate ones at once."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager
from typing import Any

from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import CompanionError, FlightError
from companion.core.types import AutopilotStatus
from companion.protocol import commands
from companion.protocol.commands import AT_ONCE, Command
from companion.protocol.telemetry import Answer, Doing
from companion.service.command_job import CHANNELS, CommandJob, SendReply, channels_of
from companion.service.flight_actions import FlightActions
from companion.service.immediate_commands import ImmediateCommands
from companion.service.queued_commands import NegativeResultError, QueuedCommands, Result
from companion.service.traffic import Traffic, no_traffic
from companion.supervisor.flight_state import FlightState

LOG = logging.getLogger(__name__)


class CommandDispatcher:
    """Executor of validated commands; replies to each: refused, or accepted and later done or failed.

    Verbs of AT_ONCE reach the flight loop in the same turn of the event loop, whatever else is under way. Commands that
    they end, or that are still being prepared, are answered as failed: nothing sent before them starts after them. Of
    the others, one for the flight and one for the arms run at a time.
    """

    def __init__(
        self,
        config: CompanionConfig,
        note_law: Callable[[str], None],
        rival: Callable[[], str],
        traffic: Traffic | None = None,
    ) -> None:
        """`note_law` gets the name of a law before that law takes over.

        `rival` returns the conflict when another service uses this vehicle's name or body; arming is refused then.
        `traffic` compares ways with the other vehicles'; None in a room with one.
        """
        self._config, self._note_law, self._rival = config, note_law, rival
        self._traffic = no_traffic() if traffic is None else traffic
        self._service: FlightActions | None = None
        self._waiting = "the service starts"
        self._jobs: dict[str, CommandJob] = {}
        """Commands under way by channel: flight, arms."""
        self._tasks: dict[asyncio.Task[None], CommandJob] = {}

    @asynccontextmanager
    async def serving(self, service: FlightActions) -> AsyncIterator[None]:
        """Accept commands for this vehicle; at the end those under way are answered as failed."""
        self._service = service
        try:
            yield
        finally:
            self._service, self._waiting = None, "the connection to it was lost, or the service ends"
            for job in self._tasks.values():
                job.call_off(self._waiting)
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def waits_for(self, reason: str) -> None:
        """Refuse commands with the reason why there is no vehicle, until one is served."""
        self._waiting = reason

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

    def _work(self, job: CommandJob) -> Coroutine[Any, Any, str | Result]:
        """Return the coroutine that carries it out, or raise CompanionError. Immediate verbs have started by then."""
        command, service = job.command, self._service
        if service is None:
            raise FlightError(f"there is no vehicle yet: {self._waiting}")
        if command.verb in AT_ONCE:
            work = ImmediateCommands(service, job, self._config.px4.answer_timeout_s).begin()
            if not isinstance(command, commands.Resume):
                self._call_off(CHANNELS, f"{command.verb} was ordered")
            return work
        if isinstance(command, commands.Arm | commands.TakeOff) and self._rival():
            raise FlightError(self._rival())
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
        return QueuedCommands(service, self._config, job, self._note_law, self._traffic).run()

    def _call_off(self, channels: Iterable[str], why: str) -> None:
        """Cancel commands in preparation; those that have started are ended by the flight or by the arms."""
        for channel in channels:
            job = self._jobs.get(channel)
            if job is not None and job.preparing:
                job.call_off(why)

    async def _carry_out(self, job: CommandJob, work: Coroutine[Any, Any, str | Result]) -> None:
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
        except NegativeResultError as error:
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
