"""The mock without arms, in a process of its own, that lets things go wrong when told and tells at the end what it saw.

Lines on standard input: "begin" (the fault begins now) or a fault's sentence; at their end what was flown is printed.
"""

import asyncio
import json
import sys
from dataclasses import asdict

import uvloop

from companion.cli.demo.mock_process import MockPorts
from mock_autopilot.config import MockConfig
from mock_autopilot.faults.sentences import parse
from mock_autopilot.simulator import Simulator
from tests.flights.command import ROOT
from tests.flights.faults.rows import CONFIG
from tests.flights.faults.watch import Watch, fence_of


def configured(ports: MockPorts) -> MockConfig:
    """config/mock.toml without arms, on these ports."""
    values = MockConfig.load(ROOT / "config" / "mock.toml").model_dump()
    values["arms"]["enabled"] = False
    values["mavlink"] |= {"remote_port": ports.client, "local_port": ports.autopilot}
    values["qualisys"]["port"] = ports.qualisys
    return MockConfig.from_dict(values)


async def _serve(ports: MockPorts) -> None:
    lines = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    async with Simulator(configured(ports), 1) as simulator:
        watch = Watch(simulator.world, fence_of(CONFIG), simulator.started_s)
        print("ready", flush=True)
        while line := (await lines.readline()).decode().strip():
            simulator.catch_up()
            watch.begin()
            print("begun", flush=True)
            if line != "begin":
                simulator.world.inject(parse(line))
        simulator.catch_up()
        print(json.dumps(asdict(watch.flown)), flush=True)


if __name__ == "__main__":
    client, autopilot, qualisys = (int(text) for text in sys.argv[1:])
    uvloop.run(_serve(MockPorts(client, autopilot, qualisys)))
