"""Bridge's sender: publishes every pose at once, and while the broker is slow only the newest."""

import asyncio
import itertools
import logging
import secrets
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import aiomqtt
import paho.mqtt.client as paho
from pydantic import ValidationError

from companion.adapters.mqtt.feed import Feed
from companion.adapters.mqtt.reconnector import LoggedReconnector, endpoint
from companion.adapters.system.background import background
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import MocapError
from companion.protocol.mocap import BridgePresence, MocapPose

LOG = logging.getLogger(__name__)

_BEAT_S = 0.2
_PATIENCE_S = 0.1
"""A beat that is not acknowledged within this time shows a slow broker; nothing more is sent until it answers, as
queued poses would arrive later and later.
"""
_ECHO_BEATS = 10
"""Beats within which the first comes back to us, too, if the broker lets us read and write there."""
_LISTEN_S = 1.2
"""Another bridge is heard more than once within this."""


@asynccontextmanager
async def open_mocap_out(broker: OperatorConfig) -> AsyncIterator["MocapOut"]:
    """Connect and reconnect in the background. ConfigError when password or certificate cannot be read."""
    out = MocapOut(broker)
    async with background(out.keep(), "companion.mocap_out"):
        yield out


class MocapOut:
    """Sender of the bridge's poses, made by `open_mocap_out`; for its event loop only."""

    def __init__(self, broker: OperatorConfig) -> None:
        self._where, self._topics = f"{broker.host}:{broker.port}", broker.topics
        self._presence = BridgePresence(
            online=True, session=secrets.token_hex(8), host=socket.gethostname(), since_s=time.time()
        )
        gone = self._presence.model_copy(update={"online": False}).model_dump_json().encode()
        self._endpoint = endpoint(broker, aiomqtt.Will(self._topics.mocap_bridge, gone, qos=1, retain=True))
        self._broker_link = LoggedReconnector(f"the broker {self._where}")
        self._alone = self._echoed = False
        self._newest: MocapPose | None = None
        self._shown, self._answers = asyncio.Event(), asyncio.Event()
        self.sent = 0
        """Poses that the broker's connection has taken."""
        self.passed_over = 0
        """Poses in whose place a newer one was sent, or none, because the broker was slow or not there any more."""
        self.refused: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Fails with MocapError when another bridge forwards the same vehicle."""

    @property
    def why(self) -> str:
        """Reason why no poses are sent; empty while they are."""
        if self._broker_link.there:
            return "" if self._alone else "listens whether another bridge is at work"
        return f"no broker at {self._where}" + (f": {self._broker_link.why}" if self._broker_link.why else "")

    def show(self, pose: MocapPose) -> None:
        """Send the pose now, or as soon as possible unless a newer one replaces it. Never waits."""
        if self._newest is not None and self._alone:  # before that none was to be sent
            self.passed_over += 1
        self._newest = pose
        self._shown.set()

    def say_trouble(self, why: str) -> None:
        """Publish the reason why there are no frames with the presence; empty when there are frames."""
        self._presence = self._presence.model_copy(update={"trouble": why[:1000]})

    async def keep(self) -> None:
        """Connect, again and again, until cancelled."""
        await self._broker_link.keep(self._connected)

    async def _connected(self, version: aiomqtt.ProtocolVersion) -> None:
        async with Feed(self._endpoint, version, self._on_message) as feed:
            await feed.follow(self._topics.mocap_bridge)
            self._broker_link.heard()
            self._answers.clear()
            if not self._alone:  # once in a run: later the vehicle may fly by our frames
                await feed.lost_within(_LISTEN_S)
                self._alone = True
            async with asyncio.TaskGroup() as group:
                group.create_task(self._beat(feed), name="companion.mocap_out.beat")
                group.create_task(self._publish_newest(feed), name="companion.mocap_out.poses")

    async def _beat(self, feed: Feed) -> None:
        """Publish the presence periodically; the broker's acknowledgement proves that it is alive."""
        for beat in itertools.count():
            if beat == _ECHO_BEATS and not self._echoed:
                unseen = "a second bridge would not be noticed"
                topic = self._topics.mocap_bridge
                LOG.warning("the broker %s does not let us read and write %s: %s", self._where, topic, unseen)
            online = self._presence.model_dump_json().encode()
            slow = asyncio.get_running_loop().call_later(_PATIENCE_S, self._answers.clear)
            try:
                await feed.publish(self._topics.mocap_bridge, online, qos=1, retain=True)
            finally:
                slow.cancel()
            self._answers.set()
            self._broker_link.heard()
            await feed.lost_within(_BEAT_S)

    async def _publish_newest(self, feed: Feed) -> None:
        while True:
            await self._shown.wait()
            await self._answers.wait()
            self._shown.clear()
            pose, self._newest = self._newest, None
            if pose is not None:
                await feed.publish(self._topics.mocap, pose.model_dump_json().encode(), qos=0)
                self.sent += 1

    def _on_message(self, message: paho.MQTTMessage) -> None:
        """Handle presence messages; a retained one is ignored, as its bridge may have ended."""
        if message.retain:
            return
        try:
            other = BridgePresence.model_validate_json(message.payload)
        except ValidationError:
            return
        ours = self._presence
        if other.session == ours.session:
            self._echoed = True
        elif other.online and not self.refused.done():
            self._give_way(other, ours)

    def _give_way(self, other: BridgePresence, ours: BridgePresence) -> None:
        if not self._alone or (other.since_s, other.session) < (ours.since_s, ours.session):
            self.refused.set_exception(
                MocapError(
                    f"the mocap bridge on {other.host!r} forwards this vehicle already ({self._topics.mocap} at "
                    f"{self._where}): end one of the two, or give this one another prefix or vehicle"
                )
            )
