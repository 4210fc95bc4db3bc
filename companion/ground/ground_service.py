"""Service of the law on the ground: devices, loop, and the vehicle's questions."""

import asyncio
import json
import logging
import sys
from collections.abc import Callable, Coroutine
from typing import Any

from companion.adapters.law_link.udp import GroundLink, open_ground_link
from companion.adapters.mocap.source import open_mocap
from companion.adapters.system.background import background
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.realtime import SWITCH_INTERVAL_S, spare_the_collector
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.control.controller import Controller
from companion.control.pipeline import ControlPipeline
from companion.core.interfaces import CompanionError, ConfigError, MocapError
from companion.flight.arm_step import feedforward_of
from companion.flight.assembly import controller_of, estimator_of, margin_in, period_s
from companion.ground.ground_law import GroundLaw, GroundParts
from companion.ground.ground_loop import GroundLoop
from companion.law_link.ground_end import GroundEnd
from companion.service.margin_process import measure_apart
from companion.service.planning import load_law
from companion.supervisor.flight_state import Phase

LOG = logging.getLogger(__name__)

_RETRY_S = 2.0
_POLL_S = 0.02
_AGE_S = 0.5
_PHASES = tuple(Phase)


def with_link(config: CompanionConfig, up_age_s: float) -> CompanionConfig:
    """Return the configuration for a law whose commands arrive `up_age_s` late: its poses are older by that."""
    mocap = config.mocap.model_copy(update={"delay_s": config.mocap.delay_s + up_age_s})
    return config.model_copy(update={"mocap": mocap})


def parts_of(config: CompanionConfig) -> GroundParts:
    """Return the parts of the law on the ground."""
    step_s = period_s(config)
    return GroundParts(
        pipeline=lambda made: ControlPipeline(made, config.vehicle.thrust_model(), config.limits.limits()),
        estimator=estimator_of(config),
        feedforward=None
        if config.arms is None
        else feedforward_of(config.arms, config.vehicle_model(), config.airframe(), step_s),
        period_s=step_s,
        delay_s=config.law.link.delay_s,
        with_pose=not config.law.onboard_mocap,
    )


async def serve_law(config: CompanionConfig, controller: LoadedController, stop: asyncio.Event) -> None:
    """Run the law until `stop` is set; motion capture that is lost is sought again, and the vehicle is told meanwhile.

    Raises ConfigError for a key or address that cannot be used.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    clock, parts = MonotonicClock(), parts_of(config)
    first = controller_of(with_link(config, parts.delay_s), controller.name, controller.unstable_allowed)
    async with open_ground_link(config, controller.name, clock) as link:
        law = GroundLaw(link.end, parts, controller.name, first.law)
        spare_the_collector()
        beside = _Beside(link.end, law, config, controller.unstable_allowed)
        async with (
            background(_repeat(beside.speak, _POLL_S), "companion.law_link"),
            background(_repeat(beside.follow_age, _AGE_S), "companion.law_age"),
        ):
            while not stop.is_set():
                try:
                    await _until(stop, _with_mocap(config, link, law, clock, parts.period_s))
                except MocapError as error:
                    LOG.error("no motion capture: %s; next attempt in %g s", error, _RETRY_S)  # noqa: TRY400
                    await _beat_on(link, law, clock, stop)
    LOG.info("the law on the ground ends")


async def _with_mocap(
    config: CompanionConfig, link: GroundLink, law: GroundLaw, clock: MonotonicClock, step_s: float
) -> None:
    async with open_mocap(config, clock) as mocap:
        LOG.info("motion capture is there; the law %s waits for the vehicle at %s", law.name, config.law.link.host)
        await GroundLoop(mocap, link, law, clock, step_s).run()


async def _until(stop: asyncio.Event, work: Coroutine[Any, Any, None]) -> None:
    task, stopping = asyncio.create_task(work), asyncio.create_task(stop.wait())
    try:
        await asyncio.wait({task, stopping}, return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
    finally:
        task.cancel()
        stopping.cancel()
        await asyncio.gather(task, stopping, return_exceptions=True)


async def _beat_on(link: GroundLink, law: GroundLaw, clock: MonotonicClock, stop: asyncio.Event) -> None:
    """Tell the vehicle, until the next attempt, that the law sees nothing."""
    end_s = clock.now_s() + _RETRY_S
    while clock.now_s() < end_s and not stop.is_set():
        law.tick(clock.now_s(), _POLL_S)
        link.send_due()
        await asyncio.sleep(_POLL_S)


async def _repeat(step: Callable[[], Coroutine[Any, Any, None]], period_s: float) -> None:
    """Do a step again and again; one that fails is logged, and ends no flight."""
    while True:
        try:
            await step()
        except Exception:
            LOG.exception("beside the law")
        await asyncio.sleep(period_s)


class _Beside:
    """Work beside the law: what changes on the link, the vehicle's questions, and the age of the uplink."""

    def __init__(self, end: GroundEnd, law: GroundLaw, config: CompanionConfig, allow_unstable: bool) -> None:
        self._end, self._law, self._config, self._allow_unstable = end, law, config, allow_unstable
        self._session, self._refused, self._phase = end.session, "", 0

    async def speak(self) -> None:
        """Log what has changed on the link, and answer the vehicle's question."""
        end = self._end
        if end.session != self._session:
            self._session = end.session
            LOG.info("the vehicle at %s has taken the law %s", self._config.law.link.host, self._law.name)
        if end.refused != self._refused:
            self._refused = end.refused
            if self._refused:
                LOG.error("the vehicle refuses: %s", self._refused)
        if end.report is not None and end.report.phase != self._phase:
            self._phase = end.report.phase
            LOG.info("the vehicle: %s", _PHASES[self._phase])
        question = end.asked
        if question is not None and question.text:
            end.answer(question, await _answer(question.text, self._law, self._config))

    async def follow_age(self) -> None:
        """Make the law anew, on the ground, for the age that the vehicle measures; reject one without enough margin."""
        age_s = self._law.wants_law_for_s
        if age_s is None:
            return
        aged = with_link(self._config, age_s)
        try:
            law = await asyncio.to_thread(_made, self._law.name, aged, self._allow_unstable)
        except ConfigError as error:
            self._law.reject(f"commands are {1e3 * age_s:.0f} ms old when they are used: {error}", age_s)
        else:
            self._law.adopt(law, age_s)


def _made(name: str, config: CompanionConfig, allow_unstable: bool) -> Controller:
    loaded = controller_of(config, name, allow_unstable)
    margin_in(config, loaded, measure_apart)
    return loaded.law


async def _answer(question: str, law: GroundLaw, config: CompanionConfig) -> str:
    """Return the answer to `{"controller": NAME}`: the law is loaded, judged, and flies from the next cycle on."""
    try:
        name = str(json.loads(question)["controller"])
        made = await asyncio.to_thread(load_law, name, with_link(config, law.made_for_s))
    except CompanionError as error:
        return json.dumps({"refused": str(error)})
    except (ValueError, KeyError, TypeError) as error:
        return json.dumps({"refused": f"the ground law cannot read {question!r}: {error}"})
    law.switch(name, made)
    return json.dumps({"flies": name})
