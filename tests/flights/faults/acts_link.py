"""Faults of the link to a law on the ground, of that law, and of others in the network."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from random import Random

from companion.control.controller import Controller
from companion.control.gains import PidGains
from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import Command, UpFlags
from companion.law_link.vehicle_end import VehicleEnd
from mock_autopilot.physics.truth import Truth
from tests.flights.faults.acts import GivesNan, Raises
from tests.flights.faults.rows import Act
from tests.flights.simulated import Flight
from tests.flights.simulated_ground import KEY, VEHICLE, Datagram, GroundWorld

STRANGER = ("a stranger", 4711)
OTHER_KEY = b"the key of another room's vehicle"


def world_of(flight: Flight) -> GroundWorld:
    """Return the ground of a flight that has one."""
    assert flight.ground is not None
    return flight.ground


def later(flight: Flight, after_s: float, do: Callable[[], None]) -> None:
    """Do something once, when so much time has passed."""
    world = flight.room.bench.world
    due_s, waiting = world.time_s + after_s, [do]

    def look(truth: Truth) -> None:
        if waiting and truth.time_s >= due_s:
            waiting.pop()()

    world.observers.append(look)


def law_dies(flight: Flight) -> None:
    """End the ground law's process."""
    world_of(flight).kill(world_of(flight).ground)


def law_restarts(after_s: float) -> Act:
    """Return an act after which the ground law begins again, with a hello in the air."""

    def restart(flight: Flight) -> None:
        law_dies(flight)
        later(flight, after_s, lambda: _begin_again(world_of(flight)))

    return restart


def _begin_again(world: GroundWorld) -> None:
    world.ground = world.begin("ground")


def law_stops(for_s: float) -> Act:
    """Return an act after which the ground law's process gets no time (SIGSTOP)."""

    def stop(flight: Flight) -> None:
        ground = world_of(flight).ground
        ground.stopped = True

        def go_on() -> None:
            ground.stopped = False

        later(flight, for_s, go_on)

    return stop


def another_law(flight: Flight) -> None:
    """Start a second ground law with the right key."""
    world_of(flight).begin("another computer")


def law_with_wrong_key(flight: Flight) -> None:
    """Start a ground law with the key of another vehicle."""
    world_of(flight).begin("another room", OTHER_KEY)


def law_of_another_version(flight: Flight) -> None:
    """End the ground law, and start one of another version."""
    law_dies(flight)
    world_of(flight).begin("an old computer", version="0.1")


def blind(flight: Flight) -> None:
    """Let no frame reach the ground any more; the vehicle's go on."""
    world_of(flight).ground.sees = False


def clock_jumps(by_s: float) -> Act:
    """Return an act that changes the ground's clock."""

    def jump(flight: Flight) -> None:
        world_of(flight).ground.offset_s += by_s

    return jump


def law_becomes(law: Controller) -> Act:
    """Return an act that puts another law into the ground's pipeline; flown with "pid"."""

    def exchange(flight: Flight) -> None:
        world_of(flight).ground.law._pipeline._controller = law

    return exchange


law_raises, law_gives_nan = law_becomes(Raises(PidGains())), law_becomes(GivesNan(PidGains()))


def _sent_by_strangers(datagrams: Callable[[Flight], Iterator[bytes]], a_step: int) -> Act:
    """Return an act that sends these, so many in each 2 ms; half of them say that they come from the ground."""

    def send(flight: Flight) -> None:
        split, left = world_of(flight), datagrams(flight)

        def go_on(truth: Truth) -> None:
            for number, data in enumerate(islice(left, a_step)):
                source = STRANGER if number % 2 else split.ground.address
                split.network.send(Datagram(data, source, VEHICLE, truth.time_s))

        flight.room.bench.world.observers.append(go_on)

    return send


def _garbage(count: int) -> Iterator[bytes]:
    rng = Random(1)
    return (rng.randbytes(rng.randrange(200)) for _ in range(count))


def _earlier_flight(cycles: int = 3000) -> Iterator[bytes]:
    """Yield what a ground law with the right key sent in an earlier session: the same epoch, other nonces."""
    random = Random(7).randbytes
    me = Introduction(version="", law="etnn", host="earlier", agreed={})
    vehicle, ground = VehicleEnd(KEY, me, random), GroundEnd(KEY, me, random, beat_s=0.03)
    ground.flags, ground.epoch = UpFlags.FLYING, 1
    command = Command(accel_w_mps2=(3.0, 3.0, 3.0), yaw_rad=1.0, capture_ago=0)
    for cycle in range(cycles):
        ground.command(replace(command, yaw_rad=1e-3 * cycle))
        for datagram in ground.tick(0.01 * cycle):
            reply = vehicle.hear(datagram, 0.01 * cycle, "ground")
            if reply is not None:
                ground.hear(reply, 0.01 * cycle)
            yield datagram


def _broken_copies(flight: Flight) -> Iterator[bytes]:
    rng = Random(2)
    for one in list(world_of(flight).network.sent_up):
        data = bytearray(one.data)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        yield bytes(data)


garbage = _sent_by_strangers(lambda _: _garbage(10_000), 10)
"""10,000 datagrams in 2 s."""
earlier_flight_again = _sent_by_strangers(lambda _: _earlier_flight(), 2)
this_flight_again = _sent_by_strangers(lambda flight: iter([one.data for one in world_of(flight).network.sent_up]), 2)
"""Everything that was sent up so far in this flight, played again."""
broken_copies = _sent_by_strangers(_broken_copies, 2)
