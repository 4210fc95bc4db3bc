"""Effects of motion capture's faults on frames and packets."""

from collections.abc import Callable

import numpy as np
import pytest

from mock_autopilot.faults.mocap import CORNER_M, MocapFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.faults.sentences import parse
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.qtm.packets import HEADER, Body, BodyPose, Component, Frame, PacketType, data_packet

RATE_HZ = 100.0
BEGIN_S, END_S = 1.0, 2.0


def _about_x(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _captured(number: int) -> Frame:
    """Our body on its way along y, rolled a little, a metre up; another one beside it."""
    position = np.array([0.1, 0.001 * number, 1.0])
    ours = BodyPose(position, _about_x(0.1 + 1e-4 * number), 0.0005)
    return Frame(number, number * 10_000, (ours, BodyPose(np.array([1.0, 2.0, 0.0]), np.eye(3), 0.0005)))


def _flown(sentence: str, seed: int = 1, to_s: float = 3.0) -> list[tuple[float, Frame]]:
    """Return times and frames that leave in three seconds, with a fault in the middle one."""
    schedule = FaultSchedule([parse(f"{sentence} on the ground after {BEGIN_S:g} s for {END_S - BEGIN_S:g} s")])
    faults = MocapFaults(schedule, np.random.default_rng(seed), RATE_HZ)
    left = []
    for tick in range(round(to_s * 250)):
        now_s = tick * 0.004
        schedule.step(now_s, False, False, False)
        before, now = int((now_s - 0.004) * RATE_HZ + 1e-6), int(now_s * RATE_HZ + 1e-6)
        frames = [_captured(number) for number in range(before + 1, now + 1)]
        left += [(now_s, frame) for frame in faults.pass_on(frames, now_s)]
    return left


def _during(left: list[tuple[float, Frame]]) -> list[Frame]:
    return [frame for now_s, frame in left if BEGIN_S <= now_s < END_S]


def _same(one: Frame, other: Frame) -> bool:
    return (one.number, one.stamp_us) == (other.number, other.stamp_us) and all(
        np.array_equal(a.position_room_m, b.position_room_m)
        and np.array_equal(a.rotation_room_flu, b.rotation_room_flu)
        for a, b in zip(one.bodies, other.bodies, strict=True)
    )


@pytest.mark.parametrize("sentence", ["mocap off", "mocap stuck", "mocap garbage", "mocap wrong (swapped and frozen)"])
def test_before_and_after_it_all_is_well(sentence: str) -> None:
    left = _flown(sentence)
    healthy = [frame for now_s, frame in left if not BEGIN_S <= now_s < END_S]
    assert len(healthy) == 199
    assert all(_same(frame, _captured(frame.number)) for frame in healthy)


def test_off_sends_nothing() -> None:
    assert _during(_flown("mocap off")) == []


def test_stuck_repeats_the_poses_to_the_last_bit_while_numbers_and_stamps_go_on() -> None:
    frames = _during(_flown("mocap stuck"))
    assert [frame.number for frame in frames] == list(range(100, 200))
    assert [frame.stamp_us for frame in frames] == [10_000 * number for number in range(100, 200)]
    assert len({frame.bodies[0].position_room_m.tobytes() for frame in frames}) == 1
    assert len({frame.bodies[0].rotation_room_flu.tobytes() for frame in frames}) == 1
    assert np.array_equal(frames[0].bodies[0].position_room_m, _captured(100).bodies[0].position_room_m)


def test_garbage_is_anywhere_and_no_rotation() -> None:
    poses = [frame.bodies[0] for frame in _during(_flown("mocap garbage"))]
    places = np.array([pose.position_room_m for pose in poses])
    assert places.std(axis=0).min() > 3.0
    errors = [np.abs(p.rotation_room_flu @ p.rotation_room_flu.T - np.eye(3)).max() for p in poses]
    assert min(errors) > 0.05


Check = Callable[[Frame, BodyPose], bool]


@pytest.mark.parametrize(
    ("sentence", "as_it_should"),
    [
        ("mocap wrong (jump) by -0.7 m", lambda seen, true: np.allclose(_moved(seen, true), [-0.7, 0, 0])),
        (
            "mocap wrong (drift) by 0.5 m/s",
            lambda seen, true: np.allclose(_moved(seen, true), [0.5 * (seen.number - 100) / RATE_HZ, 0, 0], atol=0.003),
        ),
        ("mocap wrong (upside down)", lambda seen, true: _ours(seen)[2, 2] < -0.9 and not _moved(seen, true).any()),
        (
            "mocap wrong (mirrored)",
            lambda seen, true: (
                np.allclose(_place(seen), true.position_room_m * [1, -1, 1])
                and np.allclose(_ours(seen), true.rotation_room_flu.T)  # a roll the other way round
            ),
        ),
        (
            "mocap wrong (axes swapped)",
            lambda seen, true: (
                np.allclose(_place(seen), true.position_room_m[[1, 0, 2]])
                and np.isclose(np.linalg.det(_ours(seen)), 1.0)
            ),
        ),
        ("mocap wrong (turned) by 0.6 rad", lambda seen, true: np.isclose(_turn_between(seen, true)[2], 0.6)),
        ("mocap wrong (tilted) by 0.4 rad", lambda seen, true: np.isclose(_turn_between(seen, true)[0], 0.4)),
        ("mocap wrong (lost)", lambda seen, _: bool(np.isnan(_place(seen)).all() and np.isnan(_ours(seen)).all())),
        ("mocap wrong (clock jump) by -3 s", lambda seen, _: seen.stamp_us == 10_000 * seen.number - 3_000_000),
        ("mocap wrong (swapped)", lambda seen, _: np.allclose(_place(seen), CORNER_M, atol=0.002)),
    ],
)
def test_wrong_is_wrong_in_the_way_it_says_and_nothing_else(sentence: str, as_it_should: Check) -> None:
    frames = _during(_flown(sentence))
    assert [frame.number for frame in frames] == list(range(100, 200))
    for frame in frames:
        assert as_it_should(frame, _captured(frame.number).bodies[0]), frame
        assert np.array_equal(frame.bodies[1].position_room_m, [1.0, 2.0, 0.0]), "the other body is seen as it is"


def _place(frame: Frame) -> Array:
    return frame.bodies[0].position_room_m


def _ours(frame: Frame) -> Array:
    return frame.bodies[0].rotation_room_flu


def _moved(seen: Frame, true: BodyPose) -> Array:
    return _place(seen) - true.position_room_m


def _turn_between(seen: Frame, true: BodyPose) -> Array:
    """Rotation vector (rad, body axes) for a turn about one axis."""
    r = true.rotation_room_flu.T @ _ours(seen)
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2.0
    return np.asarray(axis / max(float(np.linalg.norm(axis)), 1e-12) * np.arccos((np.trace(r) - 1.0) / 2.0))


def test_a_swapped_body_has_noise_and_a_frozen_one_has_none() -> None:
    swapped, frozen = (
        {_place(frame).tobytes() for frame in _during(_flown(f"mocap wrong ({how})"))}
        for how in ("swapped", "swapped and frozen")
    )
    assert len(swapped) == 100
    assert len(frozen) == 1


def test_out_of_order_every_second_frame_comes_behind_its_successor() -> None:
    numbers = [frame.number for frame in _during(_flown("mocap wrong (out of order)"))]
    assert numbers[:8] == [100, 102, 101, 104, 103, 106, 105, 108]
    assert sorted(frame.number for _, frame in _flown("mocap wrong (out of order)")) == list(range(1, 300))


@pytest.mark.parametrize("rate_hz", [20.0, 30.0, 400.0])
def test_slow_sends_so_many_a_second(rate_hz: float) -> None:
    frames = _during(_flown(f"mocap slow to {rate_hz:g} Hz"))
    assert len(frames) == min(rate_hz, RATE_HZ)
    gaps = np.diff([frame.number for frame in frames])
    assert gaps.max() - gaps.min() <= 1, "regularly"


def test_delayed_frames_come_later_and_in_the_end_all_at_once() -> None:
    left = _flown("mocap delayed by 0.1 s")
    late = [now_s - frame.number / RATE_HZ for now_s, frame in left if 100 <= frame.number < 190]
    assert min(late) >= 0.1 - 1e-6
    assert max(late) < 0.105
    assert [frame.number for _, frame in left] == list(range(1, 300)), "none lost, none overtaken"
    assert max(now_s for now_s, frame in left if frame.number < 200) == pytest.approx(END_S, abs=0.005)


def test_intermittent_loses_a_share_at_random_and_the_seed_decides_which() -> None:
    one, again, other = ([f.number for f in _during(_flown("mocap intermittent by 0.3", seed))] for seed in (1, 1, 2))
    assert 50 < len(one) < 90
    assert one == again != other


def _packets(sentence: str) -> list[bytes]:
    schedule = FaultSchedule([parse(sentence)])
    schedule.step(0.0, False, False, False)
    faults = MocapFaults(schedule, np.random.default_rng(1), RATE_HZ)
    return [faults.packet(data_packet(_captured(number), (Component.SIX_D,))) for number in range(100)]


def test_broken_packets_have_a_right_header_and_wrong_contents() -> None:
    packets, right = _packets("mocap garbage (packets)"), _packets("mocap stuck")
    assert right == [data_packet(_captured(number), (Component.SIX_D,)) for number in range(100)]
    assert all(HEADER.unpack_from(packet) == (len(packet), PacketType.DATA) for packet in packets)
    assert all(packet != whole for packet, whole in zip(packets, right, strict=True))
    assert len({len(packet) for packet in packets}) > 10, "some are cut off"


OURS, WAND, BOX = Body("dauam"), Body("wand"), Body("box")


@pytest.mark.parametrize(
    ("what", "listed", "places_x_m"),
    [
        ("body added", (BOX, OURS, WAND), [3.0, 0.1, 1.0]),
        ("body replaced", (BOX, WAND), [3.0, 1.0]),
        ("body deleted", (WAND,), [1.0]),
        ("body renamed", (BOX, WAND), [0.1, 1.0]),
        ("body disabled", (Body("dauam", enabled=False), WAND), [None, 1.0]),
        ("bodies reversed", (WAND, OURS), [1.0, 0.1]),
        ("no bodies", (OURS, WAND), []),
    ],
)
def test_settings_and_frames_change_together(
    what: str, listed: tuple[Body, ...], places_x_m: list[float | None]
) -> None:
    schedule, told = FaultSchedule(), list[bool]()
    faults = MocapFaults(schedule, np.random.default_rng(1), RATE_HZ)
    faults.when_bodies_change(lambda: told.append(True))
    schedule.inject(parse(f"mocap wrong ({what}) for 1 s"), 0.0)
    assert faults.listed((OURS, WAND)) == listed
    (frame,) = faults.pass_on([_captured(1)], 0.0)
    seen = [pose.position_room_m[0] for pose in frame.bodies]
    assert seen == [pytest.approx(np.nan if x is None else x, abs=0.01, nan_ok=True) for x in places_x_m]
    schedule.step(1.0, False, False, False)
    assert faults.listed((OURS, WAND)) == (OURS, WAND)
    assert told == [True, True], "QTM's event, at begin and end"


def test_a_body_that_is_gone_can_be_changed_no_further() -> None:
    schedule = FaultSchedule([parse("mocap wrong (body deleted)"), parse("mocap wrong (body disabled)")])
    faults = MocapFaults(schedule, np.random.default_rng(1), RATE_HZ)
    schedule.step(0.0, False, False, False)
    assert faults.listed((OURS,)) == ()
    (frame,) = faults.pass_on([Frame(1, 0, _captured(1).bodies[:1])], 0.0)
    assert frame.bodies == ()
