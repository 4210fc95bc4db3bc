"""Whatever is published on the pose topic: nothing is raised, garbage is counted, good frames come through again."""

import json
import math
import string
from typing import Any

import numpy as np
import paho.mqtt.client as paho
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.adapters.mocap.newest_frame import MocapCounts
from companion.adapters.mqtt.mocap import MqttMocap
from companion.config.mocap_config import MocapBrokerConfig
from companion.core.types import MocapFrame
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.protocol.mocap import MocapPose
from companion.service.mocap_bridge import pose_of
from tests.adapters.bad_bytes import one_bad
from tests.adapters.qualisys.rig import ManualClock

pytestmark = pytest.mark.slow

TOPIC = MocapBrokerConfig().topics.mocap
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_FIRST_MOST = 10
"""Good frames that may be doubted."""


def message(payload: bytes, topic: str = TOPIC, retain: bool = False) -> paho.MQTTMessage:
    said = paho.MQTTMessage(topic=topic.encode())
    said.payload, said.retain = payload, retain
    return said


def fields(**changes: Any) -> dict[str, Any]:
    good = {
        "body": "dauam",
        "frame": 7,
        "stamp_s": 1.5,
        "position_w_m": [1.0, 2.0, 3.0],
        "rotation_w_b": list(LEVEL),
        "velocity_w_mps": None,
        "residual_m": 0.0005,
        "late": 0,
    }
    return good | changes


def source_of() -> MqttMocap:
    return MqttMocap(MocapBrokerConfig(), ManualClock(), "dauam")


def hear(source: MqttMocap, said: object) -> None:
    source.on_message(message(json.dumps(said).encode()))


GOOD = tuple(
    json.dumps(pose).encode()
    for pose in (
        fields(),
        fields(position_w_m=None, rotation_w_b=None, residual_m=None),
        fields(frame=2**32 - 1, stamp_s=-1e13, velocity_w_mps=[0.1, -1e38, 1e-40]),
    )
)
GOOD_END = tuple(
    json.dumps(fields(frame=100 + number, stamp_s=2e13 / 3 + number)).encode() for number in range(_FIRST_MOST + 1)
)


@settings(max_examples=1500)
@given(one_bad(GOOD) | st.binary(max_size=300))
def test_bad_bytes_are_outlived(bad: bytes) -> None:
    source, state = source_of(), EstimatorState()
    source.on_message(message(bad))
    frame = source.latest()
    if frame is not None:  # whatever came through can be estimated from
        state = estimator.step(state, frame, EstimatorParams())
    for good in GOOD_END:
        source.on_message(message(good))
    newest = source.latest()
    assert newest is not None
    assert newest.frame == 100 + _FIRST_MOST
    estimator.step(state, newest, EstimatorParams())


@settings(max_examples=300)
@given(
    st.sampled_from(sorted(fields())),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(string.printable, max_size=8),
        lambda inner: st.lists(inner, max_size=10) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
        max_leaves=12,
    ),
)
def test_a_field_of_any_value_is_taken_rightly_or_refused(name: str, value: object) -> None:
    source = source_of()
    hear(source, fields(**{name: value}))
    frame = source.latest()
    assert (frame is None) == (source.counts.malformed == 1 or source.counts.doubted == 1)
    assert source.counts.doubted == 0 or name == "body"
    if frame is not None:
        assert frame.tracked or name in {"position_w_m", "rotation_w_b"}
        estimator.step(EstimatorState(), frame, EstimatorParams())


@pytest.mark.parametrize(
    "payload",
    [
        b'{"frame":1,"frame":2}',
        json.dumps(fields(stamp_s=math.nan)).encode(),
        json.dumps(fields(stamp_s=math.inf)).encode(),
        json.dumps(fields(stamp_s=1e14)).encode(),
        json.dumps(fields(stamp_s="1.0")).encode(),
        json.dumps(fields(frame=-1)).encode(),
        json.dumps(fields(frame=2**32)).encode(),
        json.dumps(fields(frame=1.5)).encode(),
        json.dumps(fields(position_w_m=[1.0, 2.0])).encode(),
        json.dumps(fields(position_w_m=[1e300, 0.0, 0.0])).encode(),
        json.dumps(fields(rotation_w_b=[1.0] * 8)).encode(),
        json.dumps(fields()).encode() + b" " * 2048,
        b"[" * 2000,
    ],
)
def test_what_is_no_pose_is_counted(payload: bytes) -> None:
    source = source_of()
    source.on_message(message(payload))
    assert (source.latest(), source.counts.malformed) == (None, 1)


def test_other_topics_and_retained_poses_are_not_heard() -> None:
    source = source_of()
    source.on_message(message(GOOD[0], TOPIC + "/x"))
    source.on_message(message(GOOD[0], retain=True))
    wrong = message(GOOD[0])
    wrong._topic = b"\xff\xfe"
    source.on_message(wrong)
    source.on_message(message(b"\xff", TOPIC + "/bridge"))
    assert (source.latest(), source.counts.malformed) == (None, 0)


def test_another_bodys_pose_is_not_ours(caplog: pytest.LogCaptureFixture) -> None:
    """A bridge that was started with another vehicle's body, and writes to our topic."""
    source = source_of()
    hear(source, fields())
    for number in (8, 9):
        hear(source, fields(body="leader", frame=number, stamp_s=0.01 * number + 2.0))
    assert source.counts == MocapCounts(received=1, doubted=2)
    sentence = "forwards the body 'leader', and mocap.body here is 'dauam': give both the same"
    assert caplog.text.count(sentence) == 1
    hear(source, fields(frame=10, stamp_s=3.0))
    assert source.counts.received == 2


_NUMBER = st.floats(-1e6, 1e6)


@settings(max_examples=300)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(-(2**62), 2**62),
    st.lists(_NUMBER, min_size=13, max_size=13),
    st.sampled_from(["tracked", "lost", "no residual"]),
)
def test_a_frame_comes_out_of_the_message_as_it_went_in(
    number: int, stamp_us: int, values: list[float], how: str
) -> None:
    """To the last bit, also its stamp."""
    position, rotation = np.array(values[:3]), np.array(values[3:12]).reshape(3, 3)
    if how == "lost":
        position, rotation = np.full(3, math.nan), np.full((3, 3), math.nan)
    residual_m = math.nan if how == "no residual" else values[12]
    sent = MocapFrame(
        frame=number,
        stamp_s=stamp_us * 1e-6,
        received_s=5.0,
        position_w_m=position,
        rotation_w_b=rotation,
        residual_m=residual_m,
        late=3,
    )
    source = source_of()
    source.on_message(message(pose_of("dauam", sent, EstimatorState()).model_dump_json().encode()))
    got = source.latest()
    assert got is not None
    assert (got.frame, got.stamp_s, got.received_s, got.late) == (number, sent.stamp_s, 100.0, 3)
    np.testing.assert_array_equal(got.position_w_m, position)
    np.testing.assert_array_equal(got.rotation_w_b, rotation)
    np.testing.assert_array_equal(got.residual_m, residual_m)


def test_the_velocity_is_told_only_with_a_frame_that_was_believed() -> None:
    state, params = EstimatorState(), EstimatorParams()
    rng = np.random.default_rng(1)

    def say(number: int, x_m: float) -> MocapPose:
        nonlocal state
        place = np.array([x_m, 0.0, 1.0]) + rng.normal(0.0, 1e-5, 3)
        frame = MocapFrame(
            frame=number,
            stamp_s=0.01 * number,
            received_s=0.01 * number,
            position_w_m=place,
            rotation_w_b=np.eye(3),
            residual_m=0.0,
        )
        state = estimator.step(state, frame, params)
        return pose_of("dauam", frame, state)

    poses = [say(number, 0.01 * number) for number in range(60)]
    assert poses[-1].velocity_w_mps is not None
    assert poses[-1].velocity_w_mps[0] == pytest.approx(1.0, abs=0.05)
    assert say(60, 3.0).velocity_w_mps is None, "a jump is no motion"
