"""Orders in, refusals and presence out, over a broker that may be gone at any time."""

import asyncio
import json
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import aiomqtt

from companion.adapters.mqtt.connection import Connection
from companion.config_operator import OperatorConfig
from companion.operator_orders import Order, Orders, Refusal
from companion.ports import Clock, CompanionError

LOG = logging.getLogger(__name__)

_BEAT_S = 0.5
"""With the time-out of an answer, a broker that hangs is noticed after 1.5 s."""
_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 2.0
_WAITING = 64
"""Orders and refusals that wait; what is more is lost."""

OnOrder = Callable[[Order], None]


@asynccontextmanager
async def open_operator(config: OperatorConfig, clock: Clock, on_order: OnOrder) -> AsyncIterator["MqttOperator"]:
    """Listen for orders from now on; goes on in the background while there is no broker, and never raises.

    `on_order` is called on this event loop and must not wait; a CompanionError it raises becomes a refusal, whose
    reason the operator reads.
    """
    link = MqttOperator(config, clock, on_order)
    keeping = asyncio.create_task(link.keep(), name="companion.operator")
    try:
        yield link
    finally:
        keeping.cancel()
        await asyncio.wait([keeping])


class MqttOperator:
    """`ports.OperatorLink`; made by `open_operator`.

    Topics below `<prefix>/<vehicle>/`: `order` is read; `refused` says why one was not taken, as JSON with `id` and
    `reason`; `status` is `online`, again and again, or `offline` (retained).
    """

    def __init__(self, config: OperatorConfig, clock: Clock, on_order: OnOrder) -> None:
        self._config, self._clock, self._on_order = config, clock, on_order
        self._orders = Orders()
        self._refusals: asyncio.Queue[Refusal] = asyncio.Queue(_WAITING)
        self._there = False
        self._heard_s = clock.now_s()
        self._told = ""

    def age_s(self) -> float:
        """Since the broker last answered, s; 0 while it does."""
        return 0.0 if self._there else self._clock.now_s() - self._heard_s

    async def keep(self) -> None:
        """Connect, again and again, until cancelled."""
        pause_s = _FIRST_PAUSE_S
        while True:
            try:
                await self._session()
            except Exception as error:
                self._tell_lost(error)
            pause_s = _FIRST_PAUSE_S if self._there else min(2.0 * pause_s, _LONGEST_PAUSE_S)
            self._there = False
            await asyncio.sleep(pause_s)

    async def _session(self) -> None:
        """One connection, until it breaks; raises whatever broke it."""
        async with Connection(self._config, _WAITING) as broker:
            granted = await broker.subscribe(self._config.topic("order"), qos=1)
            if any((code if isinstance(code, int) else code.value) >= 0x80 for code in granted):
                raise aiomqtt.MqttError(f"refuses the subscription to {self._config.topic('order')}")
            async with asyncio.TaskGroup() as group:
                group.create_task(self._beat(broker), name="companion.operator.beat")
                group.create_task(self._listen(broker), name="companion.operator.listen")
                group.create_task(self._answer(broker), name="companion.operator.answer")

    async def _beat(self, broker: Connection) -> None:
        """Have a broker prove that it is there. TCP alone would not show one that hangs."""
        while True:
            await broker.publish(self._config.topic("status"), b"online", qos=1, retain=True)
            broker.check()
            self._heard()
            await asyncio.sleep(_BEAT_S)

    async def _listen(self, broker: Connection) -> None:
        async for message in broker.messages:
            if message.topic.value != self._config.topic("order"):
                continue  # some brokers send retained messages nobody asked for
            if message.retain:
                self._refuse(Refusal("a retained order is an old one: publish it without retain"))
                continue
            payload = message.payload
            taken = self._orders.take(payload if isinstance(payload, bytes) else b"", time.time())
            refusal = taken if isinstance(taken, Refusal) else self._hand_on(taken)
            if refusal is not None:
                self._refuse(refusal)

    def _hand_on(self, order: Order) -> Refusal | None:
        LOG.info("the operator orders %s (%s)", order.kind, order.id)
        try:
            self._on_order(order)
        except CompanionError as error:
            return Refusal(str(error), order.id)
        except Exception as error:
            LOG.exception("the order %s (%s) failed", order.kind, order.id)
            return Refusal(f"failed: {type(error).__name__}", order.id)
        return None

    def _refuse(self, refusal: Refusal) -> None:
        """Without waiting: the next order may be an abort."""
        if self._refusals.full():
            return  # a flood; what fits in says enough
        LOG.warning("an order is refused: %r", refusal.reason)  # %r: it may hold what the sender wrote
        self._refusals.put_nowait(refusal)

    async def _answer(self, broker: Connection) -> None:
        while True:
            refusal = await self._refusals.get()
            said = json.dumps({"id": refusal.id, "reason": refusal.reason})
            await broker.publish(self._config.topic("refused"), said, qos=1)

    def _heard(self) -> None:
        self._heard_s = self._clock.now_s()
        if not self._there:
            LOG.info("the operator's broker %s is there", self._where)
            self._there, self._told = True, ""

    def _tell_lost(self, error: BaseException) -> None:
        """Once for every reason, not for every attempt."""
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        error = error.__cause__ or error
        why = "the connection broke" if isinstance(error, aiomqtt.MqttCodeError) else str(error) or type(error).__name__
        if why != self._told:
            LOG.warning("the operator's broker %s is not there: %s", self._where, why)
            self._told = why

    @property
    def _where(self) -> str:
        return f"{self._config.host}:{self._config.port}"
