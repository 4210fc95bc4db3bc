"""QTM's packets and its list of rigid bodies in simulated time: the real adapter's source, without its sockets."""

import math
from collections.abc import Sequence

from qtm_rt.packet import QRTPacket

from companion.adapters.qualisys.bodies import rigid_bodies
from companion.adapters.qualisys.source import QualisysSource
from companion.core.interfaces import Clock
from companion.core.types import MocapFrame, OtherBody
from mock_autopilot.faults.mocap import FrameFaults
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import HEADER, Component, Frame, data_packet, parameters_xml
from mock_autopilot.qtm.session import bodies_of

ANSWER_S = 0.01
"""Time from asking for the list of bodies to having it."""


class SimulatedQtm:
    """Adapter's view of frames whose list of bodies changes.

    Packing and reading cost as much as a cycle of the loop: until the list changes for the first time, frames are
    passed on as they are.
    """

    def __init__(
        self, config: QualisysConfig, faults: FrameFaults, clock: Clock, body: str = "", others: Sequence[str] = ()
    ) -> None:
        """Look at one body, the first without a name; `others` are those of the other vehicles that are seen."""
        self._config, self._faults, self._clock = config, faults, clock
        self._source = QualisysSource(body or config.body, "simulated", clock, others)
        places = {known.name: place for place, known in enumerate(bodies_of(config))}
        self._place = places[body or config.body]
        self._others = tuple((name, places.get(name)) for name in others)
        self._changed = False
        self._asked_s: float | None = None
        self._read()
        faults.when_bodies_change(self._on_change)

    def frame(self, frame: Frame) -> MocapFrame | None:
        """Return the body, and the others, in a frame that arrives now; None when it is not believed."""
        if not self._changed:
            return self._ours(frame)
        if self._asked_s is not None and self._clock.now_s() >= self._asked_s + ANSWER_S:
            self._read()
        self._source.on_packet(QRTPacket(data_packet(frame, [Component.SIX_D_RES])[HEADER.size :]))
        if self._source.list_wanted.is_set() and self._asked_s is None:
            self._asked_s = self._clock.now_s()
        newest = self._source.latest()
        return newest if newest is not None and newest.received_s == self._clock.now_s() else None

    def _on_change(self) -> None:
        self._changed, self._asked_s = True, self._clock.now_s()
        self._source.doubt_bodies()

    def _read(self) -> None:
        self._asked_s = None
        bodies = self._faults.listed(bodies_of(self._config))
        self._source.take_bodies(rigid_bodies(parameters_xml(["6d"], bodies, self._config.rate_hz).encode()))

    def _ours(self, frame: Frame) -> MocapFrame:
        pose = frame.bodies[self._place]
        return MocapFrame(
            frame=frame.number,
            stamp_s=frame.stamp_us * 1e-6,
            received_s=self._clock.now_s(),
            position_w_m=pose.position_room_m,
            rotation_w_b=pose.rotation_room_flu,
            residual_m=pose.residual_m,
            others=tuple(OtherBody(name, _seen(frame, place)) for name, place in self._others),
        )


def _seen(frame: Frame, place: int | None) -> tuple[float, float, float] | None:
    if place is None:
        return None
    x, y, z = frame.bodies[place].position_room_m.tolist()
    return (x, y, z) if math.isfinite(x + y + z) else None
