"""The UDP relay over loopback, with real sockets."""

import asyncio
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from mock_autopilot.impairment import CUT, Impairment, RelayError, parse, udp_relay

WAIT_S = 5.0


class End:
    """A UDP socket in the event loop."""

    def __init__(self, to: int | None = None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", 0))
        if to is not None:
            self.socket.connect(("127.0.0.1", to))

    @property
    def port(self) -> int:
        return int(self.socket.getsockname()[1])

    async def send(self, payload: bytes) -> None:
        await asyncio.get_running_loop().sock_sendall(self.socket, payload)

    async def receive(self) -> tuple[bytes, tuple[str, int]]:
        return await asyncio.wait_for(asyncio.get_running_loop().sock_recvfrom(self.socket, 2048), WAIT_S)


async def until(true: Callable[[], bool]) -> None:
    """Return when it is true, at the latest after WAIT_S."""
    async with asyncio.timeout(WAIT_S):
        while not true():  # noqa: ASYNC110  # the relay's counters tell nobody
            await asyncio.sleep(0.001)


@contextmanager
def ends(*to: int | None) -> Iterator[list[End]]:
    opened = [End(port) for port in to]
    try:
        yield opened
    finally:
        for end in opened:
            end.socket.close()


async def test_two_clients_are_answered_each_by_itself() -> None:
    with ends(None) as (server,):
        async with udp_relay(0, ("127.0.0.1", server.port)) as relay:
            with ends(relay.port, relay.port) as clients:
                for number, client in enumerate(clients):
                    await client.send(b"hello %d" % number)
                heard = [await server.receive() for _ in clients]
                assert len({address for _, address in heard}) == 2
                for payload, address in heard:
                    server.socket.sendto(b"answer to " + payload, address)
                for number, client in enumerate(clients):
                    assert (await client.receive())[0] == b"answer to hello %d" % number
            assert relay.up.counts.arrived == relay.down.counts.arrived == 2


async def test_each_direction_has_its_impairment_and_it_can_change() -> None:
    with ends(None) as (server,):
        async with udp_relay(0, ("127.0.0.1", server.port), up=parse("delay 50 ms")) as relay:
            with ends(relay.port) as (client,):
                loop = asyncio.get_running_loop()
                begin_s = loop.time()
                await client.send(b"slow")
                payload, address = await server.receive()
                assert payload == b"slow"
                assert loop.time() - begin_s > 0.045
                relay.set(down=CUT)
                server.socket.sendto(b"lost", address)
                await until(lambda: relay.down.counts.lost == 1)
                relay.set(up=Impairment(), down=Impairment())
                server.socket.sendto(b"heard", address)
                assert (await client.receive())[0] == b"heard"


async def test_the_share_lost_and_the_seed() -> None:
    async def arrived(seed: int) -> list[bytes]:
        with ends(None) as (server,):
            async with udp_relay(0, ("127.0.0.1", server.port), up=parse("loss 30%"), seed=seed) as relay:
                with ends(relay.port) as (client,):
                    for number in range(200):
                        await client.send(b"%d" % number)
                    await until(lambda: relay.up.counts.sent == 200)
                    return [(await server.receive())[0] for _ in range(relay.up.counts.arrived)]

    one, again, other = [await arrived(seed) for seed in (1, 1, 2)]
    assert one == again != other
    assert 110 < len(one) < 170


async def test_a_server_that_is_not_there_yet_harms_nothing() -> None:
    with ends(None) as (server,):
        port = server.port
    async with udp_relay(0, ("127.0.0.1", port)) as relay:
        with ends(relay.port) as (client,):
            await client.send(b"to nobody")
            await until(lambda: relay.up.counts.arrived == 1)
            late = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            with late:
                late.setblocking(False)
                late.bind(("127.0.0.1", port))
                await client.send(b"to somebody")
                got = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(late, 2048), WAIT_S)
            assert got == b"to somebody"


async def test_a_taken_port_and_an_unknown_host_are_named() -> None:
    with ends(None) as (server,):
        with pytest.raises(RelayError, match=f"cannot listen on UDP 127.0.0.1:{server.port}"):
            async with udp_relay(server.port, ("127.0.0.1", 9)):
                pass
        with pytest.raises(RelayError, match=r"nowhere\.invalid is no known host"):
            async with udp_relay(0, ("nowhere.invalid", 9)):
                pass
