"""Motion capture over MQTT: receives the poses that `companion mocap-bridge` publishes."""

import logging
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import aiomqtt
import numpy as np
import paho.mqtt.client as paho
from pydantic import ValidationError

from companion.adapters.mocap.newest_frame import NewestFrame
from companion.adapters.mqtt.feed import Feed
from companion.adapters.mqtt.reconnector import LoggedReconnector, endpoint
from companion.adapters.system.background import background
from companion.config.mocap_config import MocapConfig
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import Clock, MocapError
from companion.core.types import Array, MocapFrame
from companion.core.validation_messages import plain
from companion.protocol.mocap import BridgePresence, MocapPose

LOG = logging.getLogger(__name__)

_PROBE_S = 1.0
"""Period of probing a silent broker; a connection that hangs is dropped after twice this."""
_UNTRACKED_M = np.full(3, math.nan)
_UNTRACKED = np.full((3, 3), math.nan)
MAX_POSE_BYTES = 2048
"""A pose has 450."""


@asynccontextmanager
async def open_mqtt_mocap(config: MocapConfig, broker: OperatorConfig, clock: Clock) -> AsyncIterator["MqttMocap"]:
    """Connect, listen, wait for the first frame.

    Raises MocapError when none comes in time, ConfigError when password or certificate cannot be read. Later nothing is
    raised: an unreadable message is dropped, and a lost broker or bridge shows as silence, which the reader of frames
    judges, while the source reconnects in the background.
    """
    source = MqttMocap(broker, clock, config.body)
    try:
        async with background(source.keep(), "companion.mqtt_mocap"):
            if not await source.wait_unseen(config.first_frame_timeout_s):
                raise MocapError(source.why_silent())
            yield source
    finally:
        source.fail("is not listened to any more")


class MqttMocap(NewestFrame):
    """MocapSource interface: the newest frame that the bridge has forwarded. Made by `open_mqtt_mocap`."""

    def __init__(self, broker: OperatorConfig, clock: Clock, body: str) -> None:
        topics = broker.topics
        super().__init__(f"the mocap bridge (topic {topics.mocap} at {broker.host}:{broker.port})", clock)
        self._broker, self._body = broker, body
        self._foreign = ""
        """Another body that the bridge forwards."""
        self._pose_topic, self._bridge_topic = topics.mocap, topics.mocap_bridge
        self._endpoint = endpoint(broker, None)
        self._broker_link = LoggedReconnector(f"motion capture's broker {broker.host}:{broker.port}")
        self._bridge: BridgePresence | None = None

    @property
    def listens(self) -> bool:
        """True while the broker connection is up, so that the bridge's messages would arrive."""
        return self._broker_link.there

    async def keep(self) -> None:
        """Keep the connection up, reconnecting until cancelled."""
        await self._broker_link.keep(self._connected)

    async def _connected(self, version: aiomqtt.ProtocolVersion) -> None:
        """Run one connection until it breaks; raises what broke it."""
        async with Feed(self._endpoint, version, self.on_message) as feed:
            await feed.follow(self._bridge_topic)
            await feed.follow(self._pose_topic)
            while True:
                self._broker_link.heard()
                received = self.counts.received
                await feed.lost_within(_PROBE_S)
                if self.counts.received == received:
                    await feed.follow(self._pose_topic)

    def on_message(self, message: paho.MQTTMessage) -> None:
        """Handle one message; invalid content raises nothing."""
        received_s = self._clock.now_s()
        try:
            topic = message.topic
        except UnicodeDecodeError:
            return  # some brokers send what was not subscribed to
        if topic == self._pose_topic:
            self._on_pose(message.payload, message.retain, received_s)
        elif topic == self._bridge_topic:
            self._on_bridge(message.payload)

    def _on_pose(self, payload: bytes | bytearray, retained: bool, received_s: float) -> None:
        if retained:
            return None  # of any age, and the bridge retains nothing
        if len(payload) > MAX_POSE_BYTES:
            return self.on_malformed(ValueError(f"a pose of {len(payload)} bytes"))
        try:
            pose = MocapPose.model_validate_json(payload)
        except ValidationError as error:
            return self.on_malformed(ValueError(f"what is no pose ({_first_mistake(error)})"))
        return self._take(pose, received_s)

    def _take(self, pose: MocapPose, received_s: float) -> None:
        if pose.body != self._body:
            return self._on_foreign(pose.body)
        self._foreign = ""
        if self.is_overtaken(pose.frame, pose.stamp_s):
            return None
        position_w_m: Array = _UNTRACKED_M
        rotation_w_b: Array = _UNTRACKED
        if pose.position_w_m is not None and pose.rotation_w_b is not None:
            position_w_m, rotation_w_b = np.array(pose.position_w_m), np.array(pose.rotation_w_b).reshape(3, 3)
        residual_m = math.nan if pose.residual_m is None else pose.residual_m
        late = pose.late + self.counts.late
        return self.put(
            MocapFrame(
                frame=pose.frame,
                stamp_s=pose.stamp_s,
                received_s=received_s,
                position_w_m=position_w_m,
                rotation_w_b=rotation_w_b,
                residual_m=residual_m,
                late=late,
            )
        )

    def _on_foreign(self, body: str) -> None:
        """Believe no pose of another body: a bridge with another vehicle's configuration and our topics."""
        self.counts = replace(self.counts, doubted=self.counts.doubted + 1)
        if body != self._foreign:
            self._foreign = body
            LOG.error("no frames are believed: %s", self._foreign_body())

    def _foreign_body(self) -> str:
        host = self._bridge.host if self._bridge is not None else "?"
        return (
            f"the mocap bridge on {host!r} forwards the body {self._foreign!r}, and mocap.body here is {self._body!r}: "
            "give both the same"
        )

    def _on_bridge(self, payload: bytes | bytearray) -> None:
        try:
            now = BridgePresence.model_validate_json(payload)
        except ValidationError:
            return
        before, self._bridge = self._bridge, now
        if before is not None and before.online and not now.online:
            LOG.error("the mocap bridge on %r has ended", before.host)
        elif before is not None and now.trouble and now.trouble != before.trouble:
            LOG.error("the mocap bridge on %r has no frames: %r", now.host, now.trouble)

    def why_silent(self) -> str:
        """Return the sentence for no frames: what is known of the way they should have come."""
        b, bridge = self._broker, self._bridge
        if not self.listens:
            why = self._broker_link.why or "it does not answer"
            correct = f"start it, or correct host and port in [{b.table}]"
            return f"no broker for motion capture at {b.host}:{b.port} ({why}): {correct}"
        start = "start `companion mocap-bridge` on the workstation"
        if bridge is None:
            return (
                f"no frames on topic {self._pose_topic} at {b.host}:{b.port}, and no mocap bridge was ever there: "
                f"{start}, with the same prefix and vehicle, and let its user write there"
            )
        if self._foreign:
            return self._foreign_body()
        if not bridge.online:
            return f"no frames on topic {self._pose_topic}: the mocap bridge on {bridge.host!r} has ended: {start}"
        if bridge.trouble:
            return f"the mocap bridge on {bridge.host!r} has no frames: {bridge.trouble}"
        return (
            f"the mocap bridge on {bridge.host!r} is there but sends no frames on topic {self._pose_topic}: look at "
            "what it says, and whether its user may write there"
        )


def _first_mistake(error: ValidationError) -> str:
    """Return the first validation error without the sent content, which may be anything."""
    detail = error.errors(include_url=False, include_input=False)[0]
    return f"{'.'.join(str(part) for part in detail['loc'])[:60]}: {plain(detail)[:100]}"
