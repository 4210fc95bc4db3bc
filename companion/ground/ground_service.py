"""Service of the law on the ground: devices, loop, and the vehicle's questions."""

import asyncio
import json
import logging
import sys
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from companion.adapters.law_link.udp import GroundLink, open_ground_link
from companion.adapters.mocap.source import open_mocap
from companion.adapters.system.background import background, first_of
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.realtime import SWITCH_INTERVAL_S, spare_the_collector
from companion.adapters.system.systemd import Notifier
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.control.controller import Controller
from companion.core.interfaces import CompanionError, ConfigError, MocapError
from companion.flight.arm_step import feedforward_of
from companion.flight.assembly import (
    controller_of,
    estimator_of,
    ground_pipeline_of,
    margin_in,
    period_s,
    with_link,
)
from companion.ground.ground_law import GroundLaw, GroundParts
from companion.ground.ground_loop import GroundLoop, Observer, show
from companion.ground.ground_record import GroundRecorder
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import UpFlags
from companion.service.margin_process import MarginUnknownError, measure_apart
from companion.service.planning import load_law
from companion.supervisor.flight_state import PHASES

LOG = logging.getLogger(__name__)

_RETRY_S = 2.0
_POLL_S = 0.02
_AGE_S = 0.5
_STATE_S = 0.1
_SILENT_S = 1.0
_MISSED_S = 3.0
"""Silence of the vehicle that is logged."""
_REFUSED_S = 3.0
"""Time of refusal after which the service ends; a process that was just killed keeps its session for a second."""
NO_SYSTEMD = Notifier(None, None)


def parts_of(config: CompanionConfig) -> GroundParts:
    """Return the parts of the law on the ground."""
    step_s = period_s(config)
    return GroundParts(
        pipeline=partial(ground_pipeline_of, config),
        estimator=estimator_of(config),
        feedforward=None
        if config.arms is None
        else feedforward_of(config.arms, config.vehicle_model(), config.airframe(), step_s),
        period_s=step_s,
        delay_s=config.law.link.delay_s,
        oldest_s=config.safety.coast_s,
        with_pose=not config.law.onboard_mocap,
    )


async def serve_law(
    config: CompanionConfig,
    controller: LoadedController,
    stop: asyncio.Event,
    notifier: Notifier = NO_SYSTEMD,
    recorder: GroundRecorder | None = None,
) -> None:
    """Run the law until `stop` is set; motion capture that is lost is sought again, and the vehicle is told meanwhile.

    `recorder` gets every cycle, and is left open. Raises ConfigError for a key or address that cannot be used, and when
    the vehicle goes on refusing this law.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    clock, parts = MonotonicClock(), parts_of(config)
    first = controller_of(with_link(config, parts.delay_s), controller.name, controller.unstable_allowed)
    async with open_ground_link(config, controller.name, clock) as link:
        law = GroundLaw(link.end, parts, controller.name, first.law)
        spare_the_collector()
        beside = _Beside(link.end, law, config, controller.unstable_allowed)
        observers: list[Observer] = [lambda _: notifier.alive()]
        if recorder is not None:
            recorder.note_law(controller.name)
            beside.note_law = recorder.note_law
            observers.append(recorder)
        service = _Service(config, link, law, clock, notifier, observers)
        async with (
            background(_repeat(beside.speak, _POLL_S), "companion.law_link"),
            background(_repeat(beside.follow_age, _AGE_S), "companion.law_age"),
        ):
            await first_of(service.fly(parts.period_s), service.watch_link(), stop.wait())
    LOG.info("the law on the ground ends")


@dataclass(frozen=True)
class _Service:
    """Tasks that run as long as the service does."""

    config: CompanionConfig
    link: GroundLink
    law: GroundLaw
    clock: MonotonicClock
    notifier: Notifier
    observers: list[Observer]

    async def fly(self, step_s: float) -> None:
        """Connect motion capture and run the law, again and again."""
        while True:
            try:
                await self._with_mocap(step_s)
            except MocapError as error:
                LOG.error("no motion capture: %s; next attempt in %g s", error, _RETRY_S)  # noqa: TRY400
                async with background(self._beat_on(), "companion.beats"):
                    await asyncio.sleep(_RETRY_S)

    async def _with_mocap(self, step_s: float) -> None:
        async with AsyncExitStack() as devices:
            async with background(self._beat_on(), "companion.beats"):
                mocap = await devices.enter_async_context(open_mocap(self.config, self.clock))
            LOG.info("motion capture is there; the law %s waits for the vehicle", self.law.name)
            loop = GroundLoop(mocap, self.link, self.law, self.clock, step_s)
            loop.observers = self.observers
            await loop.run()

    async def _beat_on(self) -> None:
        """Tell the vehicle, while there is no motion capture, that the law sees nothing."""
        while True:
            tick = self.law.tick(self.clock.now_s(), _POLL_S)
            self.link.send_due()
            show(self.observers, tick)
            await asyncio.sleep(_POLL_S)

    async def watch_link(self) -> None:
        """Tell the link's state; raise ConfigError when the vehicle goes on refusing this law."""
        end, host = self.link.end, self.config.law.link.host
        begun_s, told = self.clock.now_s(), False
        while True:
            now_s = self.clock.now_s()
            silent = min(end.silence_s(now_s), now_s - begun_s) > _MISSED_S
            if silent and not told:
                LOG.warning("no vehicle answers at %s%s", host, self._why_silent())
            elif told and not silent:
                LOG.info("the vehicle at %s answers again", host)
            told = silent
            if end.refused_for_s(now_s) > _REFUSED_S:
                raise ConfigError(f"the vehicle at {host} refuses this ground law: {end.refused}")
            self.notifier.status(f"{self.law.name}: {_state(end, now_s)}")
            await asyncio.sleep(_STATE_S)

    def _why_silent(self) -> str:
        link = self.config.law.link
        trouble = f": {self.link.trouble}" if self.link.trouble else ""
        return f', UDP port {link.port}{trouble}; does `companion serve` run there, with law.runs_on = "ground"?'


def _state(end: GroundEnd, now_s: float) -> str:
    """Return the state of the link as a few words."""
    if end.silence_s(now_s) > _SILENT_S:
        return "no vehicle answers"
    return "flies the vehicle" if end.flags & UpFlags.FLYING else "the vehicle is there"


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
        self.note_law: Callable[[str], None] = lambda _: None
        """Called with the name of each law that is to fly."""

    async def speak(self) -> None:
        """Log what has changed on the link, and answer the vehicle's question."""
        end = self._end
        if end.session != self._session:
            self._session = end.session
            LOG.info("the vehicle at %s has taken the law %s", self._config.law.link.host, self._law.name)
        if end.refused != self._refused:
            self._refused = end.refused
            if self._refused:
                LOG.warning("the vehicle refuses: %s", self._refused)
        if end.report is not None and end.report.phase != self._phase:
            self._phase = end.report.phase
            LOG.info("the vehicle: %s", PHASES[self._phase])
        question = end.asked
        if question is not None and question.text:
            end.answer(question, await self._answer(question.text))

    async def _answer(self, question: str) -> str:
        """Return the answer to `{"controller": NAME}`: the law is loaded, judged, and flies from the next cycle on."""
        law = self._law
        try:
            name = str(json.loads(question)["controller"])
            made = await asyncio.to_thread(load_law, name, with_link(self._config, law.made_for_s))
            self.note_law(name)
        except CompanionError as error:
            return json.dumps({"refused": str(error)})
        except (ValueError, KeyError, TypeError) as error:
            return json.dumps({"refused": f"the ground law cannot read {question!r}: {error}"})
        law.switch(name, made)
        return json.dumps({"flies": name})

    async def follow_age(self) -> None:
        """Make the law anew, on the ground, for the age that the vehicle measures; reject one without enough margin."""
        age_s = self._law.wants_law_for_s
        if age_s is None:
            return
        aged = with_link(self._config, age_s)
        try:
            law = await asyncio.to_thread(_made, self._law.name, aged, self._allow_unstable)
        except MarginUnknownError as error:
            LOG.warning("%s", error)  # it is measured again; until then the law is that of before
        except ConfigError as error:
            self._law.reject(f"commands are {1e3 * age_s:.0f} ms old when they are used: {error}", age_s)
        else:
            self._law.adopt(law, age_s)


def _made(name: str, config: CompanionConfig, allow_unstable: bool) -> Controller:
    loaded = controller_of(config, name, allow_unstable)
    margin_in(config, loaded, measure_apart)
    return loaded.law
