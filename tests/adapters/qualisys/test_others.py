"""Other vehicles' bodies in QTM's frames: by name, and nowhere while QTM does not show them."""

import logging
import math

import pytest
from qtm_rt.packet import QRTPacket

from companion.adapters.qualisys.bodies import RigidBody, other_objection
from companion.adapters.qualisys.source import QualisysSource
from companion.core.types import OtherBody, Vec3
from tests.adapters.qualisys.qtm_scripts import LEVEL_BODY, frame
from tests.adapters.qualisys.rig import ManualClock

OWN, SECOND, THIRD, BOX = (RigidBody(name) for name in ("dauam-1", "dauam-2", "dauam-3", "box"))


def body_at(x_mm: float) -> list[float]:
    return [x_mm, 2000.0, 1500.0, *LEVEL_BODY[3:]]


def source_of(*bodies: RigidBody) -> QualisysSource:
    source = QualisysSource("dauam-1", "here:1", ManualClock(), ("dauam-2", "dauam-3"))
    source.take_bodies(bodies)
    return source


def others_of(source: QualisysSource, number: int, *x_mm: float) -> tuple[OtherBody, ...]:
    """Return the others after one frame with bodies at these places along x, at y = 2 m and z = 1.5 m."""
    source.on_packet(QRTPacket(frame(number, number * 10_000, [body_at(x) for x in x_mm])[8:]))
    latest = source.latest()
    assert latest is not None
    assert latest.position_w_m.tolist() != []
    return latest.others


def seen(second: float | None, third: float | None) -> tuple[OtherBody, ...]:
    """Return what is expected with the others at these x in m; None for one that is not seen."""

    def place(x_m: float | None) -> Vec3 | None:
        return None if x_m is None else (x_m, 2.0, 1.5)

    return OtherBody("dauam-2", place(second)), OtherBody("dauam-3", place(third))


def test_others_come_in_the_order_asked_for_and_not_in_that_of_qtm() -> None:
    source = source_of(THIRD, BOX, OWN, SECOND)
    assert others_of(source, 1, 3000.0, 9000.0, 1000.0, 2000.0) == seen(2.0, 3.0)
    latest = source.latest()
    assert latest is not None
    assert latest.position_w_m[0] == 1.0


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
def test_a_body_that_is_not_tracked_is_nowhere_in_this_frame_alone(lost: float) -> None:
    source = source_of(OWN, SECOND, THIRD)
    assert others_of(source, 1, 1000.0, lost, 3000.0) == seen(None, 3.0)
    assert others_of(source, 2, 1000.0, 2000.0, 3000.0) == seen(2.0, 3.0)


@pytest.mark.parametrize(
    ("bodies", "x_mm", "why"),
    [
        ((OWN, THIRD), (1000.0, 3000.0), "does not know the body 'dauam-2'"),
        ((OWN, SECOND, THIRD, SECOND), (1.0, 2.0, 3000.0, 2.0), "nobody can tell which is the other vehicle"),
        ((OWN, RigidBody("dauam-2", enabled=False), THIRD), (1.0, 2.0, 3000.0), "it is disabled there"),
        ((OWN, RigidBody("dauam-2", enabled=False), THIRD), (1.0, 3000.0), "it is disabled there"),
        ((OWN, RigidBody("dauam-2", relative=True), THIRD), (1.0, 2.0, 3000.0), "relative to another body"),
    ],
)
def test_a_body_without_a_pose_in_the_room_is_nowhere_and_logged(
    bodies: tuple[RigidBody, ...], x_mm: tuple[float, ...], why: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert why in other_objection(bodies, "dauam-2")
    with caplog.at_level(logging.ERROR):
        unseen, third = others_of(source_of(*bodies), 1, *x_mm)
    assert (unseen.position_w_m, third) == (None, seen(None, 3.0)[1])
    assert unseen.why_unseen.startswith("QTM at here:1 ")
    assert why in unseen.why_unseen
    assert [why in record.getMessage() for record in caplog.records] == [True]


def test_a_list_that_changes_in_flight_moves_no_vehicle_to_anothers_place() -> None:
    source = source_of(OWN, SECOND, THIRD)
    before = others_of(source, 1, 1000.0, 2000.0, 3000.0)
    assert others_of(source, 2, 1000.0, 3000.0) is before, "a frame of another list is not believed"
    source.take_bodies((OWN, THIRD))
    unseen, third = others_of(source, 3, 1000.0, 3100.0)
    assert (unseen.position_w_m, third) == (None, seen(None, 3.1)[1])
    source.doubt_bodies()
    source.take_bodies((THIRD, SECOND, OWN))
    assert others_of(source, 4, 3200.0, 2200.0, 1000.0) == seen(2.2, 3.2)


def test_a_source_that_is_asked_for_no_others_has_none() -> None:
    source = QualisysSource("dauam-1", "here:1", ManualClock())
    source.take_bodies((OWN, SECOND))
    assert others_of(source, 1, 1000.0, 2000.0) == ()
