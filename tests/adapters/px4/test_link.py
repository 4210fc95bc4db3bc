"""Other autopilots, several batteries and texts of any bytes on the link; against a fake PX4 over UDP."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.core.interfaces import AutopilotError
from tests.adapters.px4.fake_px4 import FakePx4, battery, extended_sys_state, text

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

ARDUPILOT = 3
ARM_DISARM, NAV_LAND, REQUEST_MESSAGE = 400, 21, 512
"""MAV_CMD."""
HOME_POSITION = 242


@asynccontextmanager
async def linked(fake: FakePx4, **changes: Any) -> AsyncIterator[Px4]:
    fields = {"url": fake.url, "connect_timeout_s": 5.0, "answer_timeout_s": 2.0} | changes
    config = Px4Config.model_validate(fields)
    async with open_px4(config, MonotonicClock()) as px4:
        yield px4


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(10.0):
        while not true():  # noqa: ASYNC110 - MAVSDK's thread tells nobody
            await asyncio.sleep(0.01)


async def test_a_second_battery_neither_lands_the_vehicle_nor_hides_an_empty_one() -> None:
    with FakePx4() as fake:
        fake.repeated += [battery(0, 90, 15.8), battery(1, 12, 10.9)]
        async with linked(fake) as px4:
            await until(lambda: len(px4.status().batteries) == 2)
            assert (px4.status().battery_id, px4.status().battery_fraction) == (0, 0.9)
        async with linked(fake, battery_id=1) as px4:
            await until(lambda: px4.status().battery_fraction == 0.12)
            assert px4.status().battery_v == pytest.approx(10.9)


async def test_a_text_that_is_no_utf_8_is_kept_without_what_a_terminal_would_obey(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with FakePx4() as fake:
        async with linked(fake) as px4:
            fake.to_send.append(text(b"\xe9\xff cold \x1b[31m"))
            await until(lambda: bool(px4.status().last_text))
            assert px4.status().last_text == "\ufffd\ufffd cold \ufffd[31m"
    assert "\x1b" not in "".join(capfd.readouterr())


async def test_a_long_text_whose_end_is_lost_is_told_without_it() -> None:
    with FakePx4() as fake:
        async with linked(fake) as px4:
            fake.to_send.append(text(b"x" * 50, 9))
            await until(lambda: px4.status().last_text == "x" * 50)


async def test_a_denial_is_forgotten_when_it_has_come_to_pass() -> None:
    with FakePx4() as fake:
        fake.armed = True
        async with linked(fake) as px4:
            await until(lambda: px4.status().armed)
            fake.to_send.append(text(b"Disarming denied: not landed"))
            await until(lambda: px4.status().last_text == "Disarming denied: not landed")
            fake.armed = False
            await until(lambda: not px4.status().armed)
            assert px4.status().last_text == ""
            fake.to_send.append(text(b"Disarmed by landing"))
            await until(lambda: px4.status().last_text == "Disarmed by landing")
            await px4.arm()
            assert px4.status().last_text == "Disarmed by landing"


_DENIED = b"Arming denied: Resolve health failures first"
_REASON = b"Preflight Fail: heading estimate invalid"


async def test_what_it_says_when_the_setpoints_begin_is_part_of_its_refusal_to_arm(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with FakePx4() as fake, caplog.at_level(logging.INFO, logger="companion.adapters.px4.telemetry"):
        fake.denials[ARM_DISARM] = _DENIED
        async with linked(fake, arm_timeout_s=0.0001) as px4:
            fake.to_send.append(text(b"GPS lost"))
            await until(lambda: px4.status().last_text == "GPS lost")
            px4.send_setpoint(idle_setpoint(0.0))
            fake.to_send.append(text(_REASON))
            await until(lambda: px4.status().last_text == _REASON.decode())
            said = f"refused to arm: {_REASON.decode()}; {_DENIED.decode()}$"
            with pytest.raises(AutopilotError, match=said):
                await px4.arm()
            px4.stop_stream()
            with pytest.raises(AutopilotError, match=f"refused to arm: {_DENIED.decode()}$"):
                await px4.arm()
    told = [record.getMessage() for record in caplog.records]
    assert [f"the autopilot says: {words}" for words in ("GPS lost", _REASON.decode(), _DENIED.decode())] == told[:3]


async def test_in_the_air_only_what_it_says_after_a_command_is_its_reason() -> None:
    with FakePx4() as fake:
        fake.armed, fake.denials[NAV_LAND] = True, b"Landing is currently not available"
        async with linked(fake) as px4:
            px4.send_setpoint(idle_setpoint(0.0))
            fake.to_send.append(text(b"Takeoff detected"))
            await until(lambda: px4.status().armed and bool(px4.status().last_text))
            with pytest.raises(AutopilotError, match=r"refused to land: Landing is currently not available$"):
                await px4.land()


async def test_the_home_position_that_an_autopilot_without_gps_has_not_is_never_asked_for() -> None:
    """MAVSDK's Telemetry asks in bursts, for ever."""
    with FakePx4() as fake:
        async with linked(fake) as px4:
            px4.send_setpoint(idle_setpoint(0.0))
            await asyncio.sleep(2.0)
        asked_for = [int(command.param1) for command in fake.commands if command.command == REQUEST_MESSAGE]
        assert asked_for
        assert HOME_POSITION not in asked_for


async def test_what_it_says_instead_of_an_answer_is_told() -> None:
    with FakePx4(answers=0.0) as fake:
        async with linked(fake, answer_timeout_s=0.5) as px4:
            telling = asyncio.create_task(px4.land())
            await until(lambda: any(command.command == NAV_LAND for command in fake.commands))
            fake.to_send.append(text(b"Parameters are being saved"))
            with pytest.raises(AutopilotError, match=r"did not answer .* land: Parameters are being saved$"):
                await telling


async def test_another_autopilot_than_px4_is_named_at_once() -> None:
    says = "is not PX4 but ArduPilot: this service flies PX4 alone"
    with FakePx4(autopilot=ARDUPILOT) as fake, pytest.raises(AutopilotError, match=says):
        async with linked(fake):
            pass


async def test_the_configured_system_is_flown_also_when_another_is_heard_first() -> None:
    with FakePx4(system=2) as other, FakePx4(other.port, system=1):
        async with linked(other, system_id=1) as px4:
            assert px4.status().system_id == 1
            host, port = other.address
            await until(lambda: px4.status().other_autopilots == (f"system 2 (PX4 at {host}:{port})",))


async def test_a_configured_system_that_is_not_there_is_told_with_those_that_are() -> None:
    says = r"px4.system_id = 7 was not heard .*, only system 2: set px4.system_id"
    with FakePx4(system=2) as fake, pytest.raises(AutopilotError, match=says):
        async with linked(fake, system_id=7, connect_timeout_s=2.0):
            pass


async def test_a_second_autopilot_of_the_same_number_is_named_and_not_listened_to() -> None:
    with FakePx4() as ours:
        async with linked(ours) as px4:
            await until(lambda: px4.status().in_air is False)
            with FakePx4(ours.port) as other:
                other.armed = True
                other.repeated = [extended_sys_state(in_air=True), battery(0, 5, 9.0)]
                host, port = other.address
                await until(lambda: px4.status().other_autopilots == (f"system 1 (PX4 at {host}:{port})",))
                await asyncio.sleep(1.0)
                status = px4.status()
                assert (status.armed, status.in_air, status.batteries) == (False, False, ())
                assert other.commands == [], "and is told nothing"
            await until(lambda: px4.status().other_autopilots == ())


async def test_an_autopilot_that_comes_back_from_another_port_is_heard_again() -> None:
    with FakePx4() as fake:
        async with linked(fake) as px4:
            before = fake.address
            fake.kill()
            heard_s = px4.status().heard_s
            fake.start()
            assert fake.address != before
            await until(lambda: px4.status().heard_s > heard_s)
            await px4.arm()


async def test_no_program_can_take_the_port_over_while_it_is_in_use() -> None:
    with FakePx4() as fake:
        async with linked(fake):
            for option in (socket.SO_REUSEADDR, 0):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
                    if option:
                        thief.setsockopt(socket.SOL_SOCKET, option, 1)
                    with pytest.raises(OSError, match="Address already in use"):
                        thief.bind(("127.0.0.1", fake.port))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as next_one:
            next_one.bind(("127.0.0.1", fake.port))


async def test_a_kernel_that_does_not_filter_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(92, "Protocol not available")

    monkeypatch.setattr("companion.adapters.px4.sender_filter._set_program", refused)
    with FakePx4() as fake:
        async with linked(fake) as px4:
            [warning] = px4.warnings
            assert "frames of every sender" in warning
            assert "Protocol not available" in warning
