"""QTM's packets as frames of one body."""

from typing import Any

from companion.adapters.qualisys.packets import body_pose
from companion.newest_frame import NewestFrame
from companion.ports import Clock
from companion.types import MocapFrame


class QualisysSource(NewestFrame):
    """`ports.MocapSource`: one body's newest frame. Made by `open_qualisys`."""

    def __init__(self, index: int, where: str, clock: Clock) -> None:
        super().__init__(f"QTM at {where}", clock)
        self.index = index
        """Place of our body among the bodies of a frame."""

    def on_packet(self, packet: Any) -> None:
        """Take a QRTPacket that has just arrived; MalformedError when our body is not in it."""
        received_s = self._clock.now_s()
        number, stamp_s = packet.framenumber, packet.timestamp * 1e-6
        if self.is_overtaken(number, stamp_s):
            return
        pose = body_pose(packet, self.index)
        late = self.counts.late
        self.put(MocapFrame(number, stamp_s, received_s, pose.position_w_m, pose.rotation_w_b, pose.residual_m, late))
