"""Test that the commands in docs/bus.md work as written."""

import asyncio
import re
import time
from pathlib import Path

import pytest

from companion.adapters.mqtt.link import BusLink
from companion.protocol.commands import COMMAND
from companion.protocol.telemetry import Happened, Reply
from tests.adapters.mqtt.rig import Vehicle, linked, state, until
from tests.mosquitto import mosquitto
from tests.packages import needs

PAGE = (Path(__file__).parents[3] / "docs" / "bus.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_its_messages_are_messages() -> None:
    command, answers, event = blocks("json")
    assert COMMAND.validate_json(command).verb == "goto"
    assert [Reply.model_validate_json(line).answer for line in answers.splitlines()] == ["accepted", "progress", "done"]
    assert Happened.model_validate_json(event).kind == "reply"


async def tell(link: BusLink) -> None:
    """Publish telemetry at 10 Hz, as the service does."""
    while True:
        link.show(state(time.time()))
        await asyncio.sleep(0.1)


@pytest.mark.realtime
@needs("mosquitto", "mosquitto_rr", "jq")
async def test_its_shell_lines_command_a_hold(tmp_path: Path) -> None:
    vehicle = Vehicle()
    [script] = blocks("sh")
    with mosquitto(tmp_path, "allow_anonymous true") as port:
        async with linked(port, vehicle) as link:
            await until(lambda: link.age_s() == 0.0)
            telling = asyncio.create_task(tell(link))
            there = script.replace("-h 127.0.0.1", f"-h 127.0.0.1 -p {port}")
            shell = await asyncio.create_subprocess_exec("sh", "-ec", there, stdout=asyncio.subprocess.PIPE)
            async with asyncio.timeout(15.0):
                said, _ = await shell.communicate()
            telling.cancel()
    assert Reply.model_validate_json(said).answer == "accepted"
    assert [command.verb for command in vehicle.commands] == ["hold"]
