"""The operator's link and an operator, on a real broker."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt

from companion.adapters.clock import MonotonicClock
from companion.adapters.mqtt import MqttOperator, open_operator
from companion.config_operator import OperatorConfig
from companion.operator_orders import Order

CLOCK = MonotonicClock()
PATIENCE_S = 15.0
ORDER, REFUSED, STATUS = (f"dauam/vehicle/{last}" for last in ("order", "refused", "status"))


class Vehicle:
    """The link's end of the flight."""

    def __init__(self) -> None:
        self.orders: list[Order] = []
        self.error: Exception | None = None

    def on_order(self, order: Order) -> None:
        self.orders.append(order)
        if self.error is not None:
            raise self.error


@asynccontextmanager
async def linked(port: int, vehicle: Vehicle) -> AsyncIterator[MqttOperator]:
    """The link, whether or not a broker is there."""
    async with open_operator(OperatorConfig(port=port), CLOCK, vehicle.on_order) as link:
        yield link


class Operator:
    """A laptop on the same broker."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client
        self.heard: list[tuple[str, bytes]] = []
        self._ids = 0

    async def say(self, payload: bytes) -> None:
        await self._client.publish(ORDER, payload, qos=1)

    async def order(self, kind: str, **changes: Any) -> str:
        """Send one order with an id of its own, which is returned."""
        self._ids += 1
        said = {"order": kind, "id": f"{id(self)}-{self._ids}", "sent_s": time.time()} | changes
        await self.say(json.dumps(said).encode())
        return str(said["id"])

    async def refusal(self) -> dict[str, str]:
        """The newest, once there is one; it is forgotten then."""
        await until(lambda: any(topic == REFUSED for topic, _ in self.heard))
        said = [payload for topic, payload in self.heard if topic == REFUSED][-1]
        self.heard.clear()
        read: dict[str, str] = json.loads(said)
        return read

    async def listen(self) -> None:
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            self.heard.append((message.topic.value, message.payload))


@asynccontextmanager
async def operating(port: int) -> AsyncIterator[Operator]:
    """An operator who hears everything below the vehicle's name."""
    async with aiomqtt.Client("127.0.0.1", port) as client:
        operator = Operator(client)
        await client.subscribe("dauam/vehicle/#", qos=1)
        listening = asyncio.create_task(operator.listen(), name="operator")
        try:
            yield operator
        finally:
            listening.cancel()
            await asyncio.wait([listening])
    await asyncio.sleep(0.01)  # its own last task ends a little later


@asynccontextmanager
async def operated(port: int, vehicle: Vehicle) -> AsyncIterator[tuple[MqttOperator, Operator]]:
    """Both, one after the other: amqtt 0.12 loses a client that connects while another subscribes."""
    async with linked(port, vehicle) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(port) as operator:
            yield link, operator


async def until(holds: Callable[[], object]) -> None:
    """Wait for something that has to come; fails when it does not."""
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110  # nobody signals: it is a status that is looked at
            await asyncio.sleep(0.005)


@asynccontextmanager
async def ticking() -> AsyncIterator[list[float]]:
    """A task that runs every 10 ms like the flight loop; the list holds the longest pause so far, s."""
    longest = [0.0]

    async def tick() -> None:
        last_s = time.monotonic()
        while True:
            await asyncio.sleep(0.01)
            now_s = time.monotonic()
            longest[0], last_s = max(longest[0], now_s - last_s), now_s

    task = asyncio.create_task(tick(), name="ticker")
    try:
        yield longest
    finally:
        task.cancel()
        await asyncio.wait([task])


def open_files() -> int:
    """How many this process has open, sockets among them."""
    return len(list(Path("/proc/self/fd").iterdir()))
