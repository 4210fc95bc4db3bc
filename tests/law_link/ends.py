"""Both ends of the link, joined by a function instead of a network."""

from random import Random

from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import Command, UpFlags
from companion.law_link.vehicle_end import Shown, VehicleEnd

KEY = b"0123456789abcdef"
ME = Introduction(version="1.0", law="etnn", host="ground", agreed={"vehicle.mass_kg": 4.85})
HOVER = Command(accel_w_mps2=(0.0, 0.0, 0.0), yaw_rad=0.0, capture_ago=100)


def shown(number: int, airborne: bool = True, epoch: int = 1) -> Shown:
    """Return the state of a vehicle that uses this command."""
    return Shown(
        airborne=airborne,
        cut=False,
        arming=False,
        phase=0,
        epoch=epoch,
        number=number,
        q_w_flu_wxyz=(1.0, 0.0, 0.0, 0.0),
        thrust=0.5,
    )


class Joined:
    """Vehicle and ground with a session; `offset_s` is the ground's clock less the vehicle's."""

    def __init__(self, offset_s: float = 0.0, seed: int = 1) -> None:
        random = Random(seed).randbytes
        self.vehicle, self.ground = VehicleEnd(KEY, ME, random), GroundEnd(KEY, ME, random, beat_s=0.03)
        self.offset_s, self.now_s = offset_s, 0.0
        self.cycle()
        self.cycle()
        self.report(shown(0, airborne=False, epoch=0))

    def sent(self) -> list[bytes]:
        """Let 10 ms pass, and return what the ground sends then."""
        self.now_s += 0.01
        return self.ground.tick(self.now_s + self.offset_s)

    def deliver(self, datagrams: list[bytes]) -> None:
        """Bring them to the vehicle, and its replies to the ground."""
        for datagram in datagrams:
            reply = self.vehicle.hear(datagram, self.now_s, "ground")
            if reply is not None:
                self.ground.hear(reply, self.now_s + self.offset_s)

    def cycle(self, command: Command | None = None) -> list[bytes]:
        """Let the ground send what is due, bring it to the vehicle, and return it."""
        if command is not None:
            self.ground.command(command)
        datagrams = self.sent()
        self.deliver(datagrams)
        return datagrams

    def report(self, state: Shown) -> None:
        """Let the vehicle report."""
        datagram = self.vehicle.report(state, self.now_s)
        assert datagram is not None
        self.ground.hear(datagram, self.now_s + self.offset_s)

    def fly(self) -> None:
        """Take off: from now on commands are used and acknowledged."""
        self.report(shown(0))
        self.ground.flags = UpFlags.FLYING
