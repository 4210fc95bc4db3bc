"""The contract of every source by way of bridge and broker, and what only MQTT can do."""

import asyncio
import getpass
import json
import logging
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import aiomqtt
import pytest
import pytest_asyncio
import uvloop

from companion.adapters.mqtt import mocap_out
from companion.adapters.mqtt.mocap import MqttMocap, open_mqtt_mocap
from companion.adapters.mqtt.mocap_out import open_mocap_out
from companion.config.mocap_config import MocapBrokerConfig, MocapConfig
from companion.core.interfaces import MocapError
from companion.protocol.mocap import BridgePresence, MocapPose
from companion.service.mocap_bridge import Bridge
from tests.adapters.mocap.contract import ARRIVES_S, NOTHING_COMES_S, MocapContract
from tests.adapters.mqtt.mocap_rig import MqttMocapRig, bridging, mqtt_mocap_rig, on_broker
from tests.adapters.mqtt.rig import CLOCK, until
from tests.adapters.qualisys.rig import capturing, serving, settings_for
from tests.broker import BrokerProcess, broker
from tests.mosquitto import lab as lab_of_the_examples
from tests.mosquitto import mosquitto, needs_mosquitto
from tests.protocol.test_lab_broker import speaking

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Yield the port of a running mosquitto."""
    with mosquitto(tmp_path_factory.mktemp("mosquitto"), "allow_anonymous true") as port:
        yield port


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mocap_out, "_LISTEN_S", 0.02)


@pytest.fixture(scope="module")
def small() -> Iterator[BrokerProcess]:
    """Yield the port of a running amqtt broker."""
    with broker() as process:
        yield process


@needs_mosquitto
class TestMqttMocap(MocapContract):
    """By the broker of a lab."""

    @pytest_asyncio.fixture
    async def rig(self, lab: int) -> AsyncIterator[MqttMocapRig]:
        async with mqtt_mocap_rig(lab) as rig:
            yield rig

    async def test_qtm_that_goes_away_and_comes_back_is_found_again(self, rig: MqttMocapRig) -> None:
        await rig.end()
        before = rig.source.latest()
        assert not await rig.source.wait_frame(NOTHING_COMES_S)
        assert rig.source.latest() is before
        async with serving(port=rig.port) as server, capturing(server):
            assert await rig.source.wait_frame(ARRIVES_S)

    async def test_every_skipped_frame_is_counted(self, rig: MqttMocapRig) -> None:
        before = rig.source.counts
        for _ in range(20):
            rig.capture()
        while await rig.source.wait_frame(NOTHING_COMES_S):
            pass
        now = rig.source.counts
        assert now.received - before.received + now.lost - before.lost == 20
        assert (now.late, now.malformed) == (0, 0)

    async def test_other_readers_have_the_velocity(self, rig: MqttMocapRig, lab: int) -> None:
        async with aiomqtt.Client("127.0.0.1", lab, protocol=aiomqtt.ProtocolVersion.V5) as reader:
            await reader.subscribe(rig.broker.topics.mocap)
            for step in range(8):
                rig.capture(position_w_m=(0.01 * step, 0.0, 1.0))
                assert await rig.source.wait_frame(ARRIVES_S)
            poses = [
                MocapPose.model_validate_json(str((await anext(reader.messages)).payload, "utf-8")) for _ in range(8)
            ]
        velocity = poses[-1].velocity_w_mps
        assert velocity is not None
        assert velocity[0] == pytest.approx(1.0, abs=0.3)

    async def test_a_frame_sent_again_or_overtaken_is_counted_late(self, rig: MqttMocapRig, lab: int) -> None:
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        frame, before = rig.source.latest(), rig.source.counts
        assert frame is not None
        again = pose(frame.frame, frame.stamp_s)
        async with aiomqtt.Client("127.0.0.1", lab, protocol=aiomqtt.ProtocolVersion.V5) as other:
            await other.publish(rig.broker.topics.mocap, again, qos=1)
            await other.publish(rig.broker.topics.mocap, pose(frame.frame - 1, frame.stamp_s - 0.01), qos=1)
        await until(lambda: rig.source.counts.late == before.late + 2)
        assert not await rig.source.wait_frame(NOTHING_COMES_S)
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)
        newest = rig.source.latest()
        assert newest is not None
        assert newest.late == frame.late + 2

    async def test_what_nobody_can_read_is_dropped_and_told_once(
        self, rig: MqttMocapRig, lab: int, caplog: pytest.LogCaptureFixture
    ) -> None:
        async with aiomqtt.Client("127.0.0.1", lab, protocol=aiomqtt.ProtocolVersion.V5) as other:
            for bad in (b"", b"{", b"\xff" * 400, b"[1]", pose(1, 1.0)[:-1], b" " * 60_000):
                await other.publish(rig.broker.topics.mocap, bad, qos=1)
        await until(lambda: rig.source.counts.malformed == 6)
        told = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
        assert len(told) == 1
        assert "sent what is no pose (: invalid JSON" in told[0]


def pose(number: int, stamp_s: float) -> bytes:
    here = MocapPose(
        body="dauam",
        frame=number,
        stamp_s=stamp_s,
        position_w_m=(0.0, 0.0, 1.0),
        rotation_w_b=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        velocity_w_mps=None,
        residual_m=None,
    )
    return here.model_dump_json().encode()


@needs_mosquitto
def test_it_flies_on_uvloop_too(lab: int) -> None:
    async def converse() -> bool:
        async with mqtt_mocap_rig(lab) as rig:
            rig.capture()
            return await rig.source.wait_frame(ARRIVES_S)

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        assert runner.run(converse())


async def test_over_amqtt_and_a_broker_that_hangs_or_begins_anew(small: BrokerProcess) -> None:
    """Silence, and then frames again, from either end without a word."""
    async with mqtt_mocap_rig(small.port) as rig, capturing(rig.server):
        assert await rig.source.wait_frame(ARRIVES_S)
        small.hang()
        try:
            await silent(rig)
        finally:
            small.go_on()
        assert await rig.source.wait_frame(ARRIVES_S)
        small.stop()
        await silent(rig)
        small.start()
        assert await rig.source.wait_frame(3 * ARRIVES_S)


async def silent(rig: MqttMocapRig) -> None:
    async with asyncio.timeout(ARRIVES_S):
        while await rig.source.wait_frame(2 * NOTHING_COMES_S):
            pass


async def refused(config: MocapBrokerConfig) -> str:
    """Return the error for a missing first frame on this broker."""
    with pytest.raises(MocapError) as error:
        async with open_mqtt_mocap(MocapConfig(source="mqtt", first_frame_timeout_s=0.3), config, CLOCK):
            pass
    return str(error.value)


async def test_without_a_broker_is_a_sentence() -> None:
    said = await refused(MocapBrokerConfig(port=1))
    assert said.startswith("no broker for motion capture at 127.0.0.1:1 (")
    assert "Connection refused" in said
    assert said.endswith("start it, or correct host and port in [mocap.broker]")


@needs_mosquitto
async def test_without_a_bridge_each_reason_is_a_sentence(lab: int) -> None:
    config = on_broker(lab)
    assert "no mocap bridge was ever there: start `companion mocap-bridge`" in await refused(config)
    async with aiomqtt.Client("127.0.0.1", lab) as other:
        for presence, sentence in (
            (BridgePresence(online=False, host="ws"), "the mocap bridge on 'ws' has ended"),
            (
                BridgePresence(online=True, host="ws", trouble="no QTM"),
                "the mocap bridge on 'ws' has no frames: no QTM",
            ),
            (BridgePresence(online=True, host="ws"), "the mocap bridge on 'ws' is there but sends no frames on topic"),
        ):
            await other.publish(config.topics.mocap_bridge, presence.model_dump_json(), qos=1, retain=True)
            assert sentence in await refused(config)
        await other.publish(config.topics.mocap_bridge, b"", qos=1, retain=True)


@needs_mosquitto
@pytest.mark.parametrize("listens_s", [0.0, ARRIVES_S], ids=["begun at once", "as it is"])
async def test_a_second_bridge_of_one_vehicle_is_refused_and_the_first_goes_on(
    lab: int, listens_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with mqtt_mocap_rig(lab) as rig, capturing(rig.server):
        monkeypatch.setattr(mocap_out, "_LISTEN_S", listens_s)
        second = Bridge(settings_for(rig.server, source="mqtt"), rig.broker, CLOCK)
        with pytest.raises(MocapError, match="forwards this vehicle already"):
            async with asyncio.timeout(ARRIVES_S):
                await second.run()
        assert await rig.source.wait_frame(ARRIVES_S)


@needs_mosquitto
async def test_the_bridge_tells_of_itself_and_of_its_end(lab: int) -> None:
    config, heard = on_broker(lab), list[BridgePresence]()

    async def listen() -> None:
        async with aiomqtt.Client("127.0.0.1", lab) as reader:
            await reader.subscribe(config.topics.mocap_bridge, qos=1)
            async for message in reader.messages:
                heard.append(BridgePresence(**json.loads(str(message.payload, "utf-8"))))

    listening = asyncio.create_task(listen())
    try:
        async with bridging(MocapConfig(source="mqtt", port=1), config) as bridge:
            await until(lambda: heard and heard[-1].online and heard[-1].trouble.startswith("no QTM at 127.0.0.1:1"))
            assert bridge.glance().trouble.startswith(heard[-1].trouble)
        await until(lambda: not heard[-1].online)
    finally:
        listening.cancel()
        await asyncio.wait([listening])


async def test_a_slow_broker_gets_the_newest_frame_and_no_queue(small: BrokerProcess) -> None:
    config, heard = on_broker(small.port), list[int]()
    async with aiomqtt.Client("127.0.0.1", small.port) as reader, open_mocap_out(config) as out:
        await reader.subscribe(config.topics.mocap)
        await until(lambda: out.why == "")

        async def listen() -> None:
            async for message in reader.messages:
                heard.append(json.loads(str(message.payload, "utf-8"))["frame"])

        listening = asyncio.create_task(listen())
        small.hang()
        try:
            for number in range(160):
                out.show(MocapPose.model_validate_json(pose(number, 0.005 * number)))
                await asyncio.sleep(0.005)
        finally:
            small.go_on()
        await until(lambda: heard and heard[-1] == 159)
        listening.cancel()
        await asyncio.wait([listening])
    assert len(heard) == out.sent == 160 - out.passed_over
    assert len(heard) < 110, "a beat and the patience with it are 0.3 s of these 0.8 s"


@needs_mosquitto
async def test_a_bridge_that_may_not_say_that_it_is_there_forwards_and_warns(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mocap_out, "_BEAT_S", 0.01)
    acl = tmp_path / "acl"
    acl.write_text("topic readwrite dauam/v1/+/mocap\n")
    acl.chmod(0o700)
    with mosquitto(tmp_path, "allow_anonymous true", f"acl_file {acl}", f"user {getpass.getuser()}") as port:
        async with mqtt_mocap_rig(port) as rig:
            await until(lambda: "a second bridge would not be noticed" in caplog.text)
            rig.capture()
            assert await rig.source.wait_frame(ARRIVES_S)


@needs_mosquitto
async def test_a_labs_broker_with_tls_and_passwords_lets_poses_of_the_bridge_alone_through(tmp_path: Path) -> None:
    """The example files of config/mosquitto/; a burst by TLS is read to its end, though the socket shows nothing."""
    with lab_of_the_examples(tmp_path) as room:
        bridge, vehicle = (MocapBrokerConfig(**room.place(user).model_dump()) for user in ("mocap-bridge", "dauam-1"))
        async with serving() as qtm, capturing(qtm), bridging(settings_for(qtm, source="mqtt"), bridge):
            config = MocapConfig(source="mqtt", first_frame_timeout_s=ARRIVES_S)
            async with open_mqtt_mocap(config, vehicle, CLOCK) as source:
                assert await source.wait_frame(ARRIVES_S)
        source = MqttMocap(vehicle, CLOCK, "dauam")
        listening = asyncio.create_task(source.keep())
        try:
            await until(lambda: source.listens)
            for stranger in ("screen", "anna", "dauam-1", "dauam-2"):
                async with speaking(room, stranger) as client:
                    await client.publish(vehicle.topics.mocap, b"elsewhere", qos=1)
            async with speaking(room, "mocap-bridge") as client:
                for number in range(100):
                    await client.publish(vehicle.topics.mocap, pose(number, 0.01 * number))
                await until(lambda: (newest := source.latest()) is not None and newest.frame == 99)
        finally:
            listening.cancel()
            await asyncio.wait([listening])
    assert (source.counts.received, source.counts.late, source.counts.malformed) == (100, 0, 0)
