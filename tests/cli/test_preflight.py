"""`companion preflight` and `companion dry-run` against the mocks, over the real protocols."""

import asyncio
import io
import json
import os
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from companion.adapters.system.instance_lock import instance_lock
from companion.cli.demo.mock_process import free_ports
from companion.cli.vehicle.preflight import CARRIED, carry_and_keep, show
from companion.config.companion_config import load_config
from companion.config.preflight_config import PreflightConfig, load_recommended
from companion.core.errors import ConfigError
from companion.preflight.checks.check import Check
from companion.preflight.checks.hand_test import HandTest, Move, check_hand_test
from companion.preflight.hand_test_file import hand_test_path, read_hand_test, require_writable, write_hand_test
from companion.records.read import read_flight
from mock_autopilot.physics.truth import Truth
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.servos.packets import Instruction, Packet
from mock_autopilot.simulator import Simulator
from mock_autopilot.world import World
from tests.broker import broker
from tests.cli.typed import disk_full_after, typing
from tests.flights.command import run, start
from tests.mavlink_relay import Relay
from tests.preflight.rig import room

pytestmark = pytest.mark.slow

TIMED = {"mocap rate", "mocap age", "vision delay"}
"""Checks that a computer busy with other tests may fail."""


@pytest.mark.realtime
async def test_the_list_against_the_mock_names_the_one_parameter_that_is_wrong(tmp_path: Path) -> None:
    spoiled = room(tmp_path, params={"COM_OF_LOSS_T": 1.0})
    async with spoiled.mock:
        ran = await run("preflight", "--json", "--config", spoiled.config, "--out", tmp_path, "--trajectory", "ellipse")
    assert ran.code == 1, ran.said
    checks = {check["name"]: check for check in json.loads(ran.out)}
    refused = {name for name, check in checks.items() if check["must"] and not check["passed"]} - TIMED
    assert refused == {"COM_OF_LOSS_T", "carried by hand"}
    assert checks["COM_OF_LOSS_T"]["says"] == "is 1, should be at least 0.2 and at most 0.5"
    assert checks["COM_OF_LOSS_T"]["todo"].startswith("set it to 0.5: ")
    for name in ("heading agrees", "vision fused", "battery", "fence around the trajectory"):
        assert checks[name]["passed"], checks[name]


@pytest.mark.realtime
async def test_every_wrong_default_of_px4_is_named_with_the_value_to_set(tmp_path: Path) -> None:
    """A vehicle as it comes out of the box."""
    own = ParamTable()
    wrong = {name: one for name, one in load_recommended("recommended").items() if not one.accepts(own[name])}
    bare = room(tmp_path, params={param.name: param.value for param in own if param.name != "SIM_BAT_DRAIN"})
    async with bare.mock:
        ran = await run("preflight", "--json", "--config", bare.config, "--out", tmp_path)
    assert ran.code == 1, ran.said
    checks = {check["name"]: check for check in json.loads(ran.out)}
    named = {name for name, check in checks.items() if own.find(name) is not None and not check["passed"]}
    assert named == set(wrong)
    for name, one in wrong.items():
        assert checks[name]["says"] == f"is {own[name]:g}, should be {one.wanted}"
        assert checks[name]["todo"].startswith(f"set it to {one.set_to:g}")


def test_every_device_that_is_missing_has_its_line_and_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ports, path = free_ports(), tmp_path / "companion.toml"
    path.write_text(
        f"[mocap]\nport = {ports.qualisys}\nconnect_timeout_s = 1.0\n"
        f'[px4]\nurl = "udpin://127.0.0.1:{ports.client}"\nconnect_timeout_s = 0.2\n'
        f'[arms]\nport = "{tmp_path / "none"}"\n[operator]\nport = {ports.autopilot}\n'
    )
    typed = typing("preflight", monkeypatch, capsys)("--config", path, "--out", tmp_path, "--json")
    checks = {check["name"]: check for check in json.loads(typed.out)}
    assert (typed.code, list(checks)) == (1, ["operator's broker", "motion capture", "autopilot", "arms"])
    assert all(check["todo"] and check["must"] and not check["passed"] for check in checks.values())
    assert str(ports.qualisys) in checks["motion capture"]["says"]
    assert "no autopilot heard" in checks["autopilot"]["says"]
    dry = typing("dry-run", monkeypatch, capsys)("--config", path, "--out", tmp_path)
    assert dry.code == 2
    for words in ("no QTM at 127.0.0.1", "no autopilot heard on udpin", "no serial port "):
        assert words in dry.err


@pytest.mark.realtime
async def test_the_operators_broker_is_met_with_all_else(tmp_path: Path) -> None:
    real = room(tmp_path)
    with broker() as there:
        real.config.write_text(f"{real.config.read_text()}[operator]\nport = {there.port}\n")
        async with real.mock:
            ran = await run("preflight", "--json", "--config", real.config, "--out", tmp_path)
    checks = {check["name"]: check for check in json.loads(ran.out)}
    assert checks["operator's broker"]["passed"], checks["operator's broker"]
    assert checks["disarmed"]["passed"]


async def test_a_vehicle_that_another_companion_flies_is_left_alone(tmp_path: Path) -> None:
    free = room(tmp_path)
    config = load_config(free.config)
    with instance_lock(config.px4.url):
        for command in ("preflight", "dry-run"):
            ran = await run(command, "--config", free.config, "--out", tmp_path)
            assert ran.code == 2, ran.said
            assert "another companion (process " in ran.err
            assert "Traceback" not in ran.said


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[preflight]\nrealtim = false\n", "preflight.realtim: unknown key, did you mean 'realtime'?"),
        ("[preflight]\nbattery = 1.5\n", "preflight.battery = 1.5: "),
    ],
)
def test_a_mistake_in_its_table_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, sentence: str
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text(text)
    for command in ("preflight", "dry-run"):
        typed = typing(command, monkeypatch, capsys)("--config", path)
        assert typed.code == 2
        assert sentence in typed.err


@pytest.mark.parametrize("command", ["preflight", "dry-run"])
def test_where_nothing_can_be_written_it_does_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    typed = typing(command, monkeypatch, capsys)
    with disk_full_after(1000):
        full = typed("--config", "config/demo.toml", "--out", tmp_path / "full")
    assert (full.code, full.out) == (2, "")
    assert full.err == f"companion: cannot write to {tmp_path / 'full'}: File too large\n"
    wrong = typed("--config", "config/mock.toml")
    assert wrong.err.startswith("companion: config/mock.toml: this is the mock's configuration; give the companion's")


def shown(*checks: Check) -> list[str]:
    console = Console(file=io.StringIO(), width=120)
    show(checks, console, as_json=False)
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def test_parameters_that_are_right_are_one_line_and_what_is_wrong_comes_last_with_what_to_do() -> None:
    right = [Check(f"PAR_{number}", True, "is 1") for number in range(20)]
    wrong = Check("COM_OF_LOSS_T", False, "is 1", "set it to 0.5")
    warned = Check("real-time priority", False, "not real-time", "set [preflight] realtime = false", must=False)
    lines = shown(Check("body seen", True, "in 100 %"), *right, wrong, warned)
    assert [line.split("  ")[1].strip() for line in lines[:4]] == [
        "body seen", "PX4's parameters", "COM_OF_LOSS_T", "real-time priority",
    ]  # fmt: skip
    assert "20 of 21 are right" in lines[1]
    assert [line.split("-> ")[-1].split("  ")[0] for line in lines[lines.index("what to do") + 1 :]] == [
        "FAIL", "set it to 0.5", "warn", "set [preflight] realtime = false",
        "1 of 23 fail: arming is refused, 1 warning",
    ]  # fmt: skip
    assert sum("set it to 0.5" in line for line in lines) == 1


def test_a_short_list_says_what_to_do_on_the_spot() -> None:
    lines = shown(Check("battery", False, "10 %", "charge it"), Check("disarmed", True, "on the ground"))
    assert [line.strip() for line in lines] == [
        "FAIL  battery   10 %", "-> charge it", "pass  disarmed  on the ground", "1 of 2 fail: arming is refused",
    ]  # fmt: skip


def test_ctrl_c_before_anything_has_begun_is_a_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    for place in ("companion.cli.vehicle.preflight.vehicle_settings", "companion.cli.commands.run"):
        monkeypatch.setattr(place, interrupted)
        typed = typing("preflight", monkeypatch, capsys)("--out", ".")  # without a word no running service is asked
        assert (typed.code, typed.out, typed.err) == (130, "", "interrupted\n")


@pytest.mark.realtime
async def test_a_move_by_hand_that_does_not_come_says_what_was_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.cli.vehicle.hand_test._PATIENCE_S", 1.5)
    real = room(tmp_path)
    async with real.mock:
        checks = await carry_and_keep(load_config(real.config), tmp_path, Console(file=io.StringIO(), width=300))
    assert [check.name for check in checks] == ["by hand: lift"]
    assert checks[0].says.startswith("no such move within 1.5 s: motion capture saw it move ")


READING = {Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ, Instruction.BULK_READ}
ASKING = {511, 512}
"""SET_MESSAGE_INTERVAL, REQUEST_MESSAGE."""


def listen_to(mock: Simulator) -> set[int]:
    """Instructions that come over the servo bus from now on."""
    heard: set[int] = set()
    assert mock.world.servos is not None
    answer = mock.world.servos.answer

    def note(packet: Packet, *rest: Any) -> Any:
        heard.add(packet.code)
        return answer(packet, *rest)

    mock.world.servos.answer = note  # type: ignore[method-assign, assignment]
    return heard


@pytest.mark.realtime
async def test_a_dry_run_reads_everything_and_sends_nothing(tmp_path: Path) -> None:
    with Relay() as relay:
        real = room(tmp_path, relay.ports, relay.url, params={"COM_DISARM_PRFLT": -1.0}, arms=True)
        async with real.mock as mock:
            instructions = listen_to(mock)
            ran = await run("dry-run", "--config", real.config, "--out", tmp_path / "out", "--seconds", "2", "--json")
            checks = {check["name"]: check for check in json.loads(ran.out)}
            assert ran.code == any(check["must"] and not check["passed"] for check in checks.values()), ran.said
            for name in ("body seen", "disarmed", "roll agrees", "pitch agrees", "battery", "arms stowed", "law"):
                assert checks[name]["passed"], checks[name]
            record = read_flight(next((tmp_path / "out").glob("*-dry-run.npz"))).columns
            assert np.isfinite(record["setpoint_thrust"]).sum() > 50, "the law was asked all the time"
            assert np.isnan(record["sent_s"]).all()

            endless = await start("dry-run", "--config", real.config, "--out", tmp_path / "cut", "--seconds", "600")
            await endless.until_line("observing for")
            await asyncio.sleep(0.3)
            endless.interrupt()
            cut = await endless.ended()
            assert cut.code == 130, cut.said
            assert "Traceback" not in cut.said
            assert len(list((tmp_path / "cut").glob("*-dry-run.npz"))) == 1

            mock.world.vehicle.arm_disarm(1.0, 21196.0)
            assert mock.world.vehicle.armed
            refused = await run("dry-run", "--config", real.config, "--out", tmp_path)
            assert refused.code == 2, refused.said
            assert "the vehicle is armed or in the air" in refused.err
    commands = {passed.message.command for passed in relay.from_client if passed.kind == "COMMAND_LONG"}
    assert commands <= ASKING, "no arming, no mode, no landing"
    kinds = {passed.kind for passed in relay.from_client} - {"COMMAND_LONG"}
    assert kinds <= {"HEARTBEAT", "PING"}, "no setpoint, no vision, no parameter"
    assert instructions
    assert instructions <= READING, "no torque, no goals"


class Hand:
    """Carries the simulated vehicle whenever it is asked to."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._from = self._to = world.state.position_ned_m.copy()
        self._since_s = 0.0
        world.observers.append(self._hold)

    def take_to(self, north_m: float, east_m: float, down_m: float) -> None:
        self._from, self._to, self._since_s = self._at(), np.array([north_m, east_m, down_m]), self._world.time_s

    def _at(self) -> Any:
        share = min(1.0, (self._world.time_s - self._since_s) / 0.8)
        return self._from + (self._to - self._from) * share * share * (3.0 - 2.0 * share)

    def _hold(self, _: Truth) -> None:
        still = np.zeros(3)
        state = replace(
            self._world.state, position_ned_m=self._at(), velocity_ned_mps=still, acceleration_ned_mps2=still
        )
        self._world.state = state


@pytest.mark.realtime
async def test_a_vehicle_that_is_carried_shows_mocap_and_autopilot_the_same(tmp_path: Path) -> None:
    real = room(tmp_path)
    config = load_config(real.config)
    wanted = config.preflight
    said = io.StringIO()
    places = {
        Move.LIFT.asks: (0.0, 0.0, -0.3),
        "put it down": (0.0, 0.0, 0.0),
        Move.FORWARD.asks: (0.5, 0.0, 0.0),
        Move.LEFT.asks: (0.5, -0.5, 0.0),
    }

    async def obey(hand: Hand) -> None:
        for asked, place in places.items():
            while asked not in said.getvalue():  # noqa: ASYNC110 - a person reads a screen
                await asyncio.sleep(0.02)
            hand.take_to(*place)

    async with real.mock as mock:
        hand = asyncio.create_task(obey(Hand(mock.world)))
        checks = await carry_and_keep(config, tmp_path, Console(file=said, width=300))
        await hand
    assert [check.name for check in checks] == ["by hand: lift", "by hand: forward", "by hand: left", "by hand: frames"]
    assert [check for check in checks if not check.passed] == []
    kept = read_hand_test(wanted)
    assert check_hand_test(kept, "dauam", datetime.now(tz=UTC), wanted.by_hand_within_h).passed
    show(checks, Console(file=said, width=300), as_json=False, good=CARRIED)
    answers = [line.strip() for line in said.getvalue().splitlines() if line.strip().startswith(("ok", "wrong"))]
    assert [answer.split(":")[0] for answer in answers] == ["ok"] * 4, said.getvalue()
    assert "take the heading" not in said.getvalue()
    assert f"kept in {real.config.parent / 'state' / 'by_hand.json'}" in said.getvalue()
    assert said.getvalue().endswith(
        "carried by hand: passed. Nothing else was looked at: `companion preflight` says whether it may arm\n"
    )


def test_when_it_was_carried_is_kept(tmp_path: Path) -> None:
    wanted = PreflightConfig(state_folder=str(tmp_path / "state"))
    path = hand_test_path(wanted)
    assert read_hand_test(wanted) == f"never: there is no {path}"
    kept = HandTest("dauam", datetime(2026, 5, 1, 12, 0, tzinfo=UTC), str(path))
    assert write_hand_test(wanted, kept) == path
    assert read_hand_test(wanted) == kept
    for nonsense in ("", "[]", '{"body": "dauam"}', '{"body": "dauam", "when": "2026-05-01T12:00:00"}', "\x00"):
        path.write_text(nonsense)
        assert read_hand_test(wanted) == f"{path} is damaged"
    path.unlink()
    path.mkdir()
    assert read_hand_test(wanted) == f"{path} cannot be read (Is a directory)"


def not_permitted(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Be a user who may not write below a folder, also as root."""
    allowed = os.access
    monkeypatch.setattr(
        os,
        "access",
        lambda path, mode: allowed(path, mode) and not (mode == os.W_OK and folder in [path, *path.parents]),
    )


def test_who_may_not_keep_it_is_told_the_command_before_the_vehicle_is_carried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = PreflightConfig(state_folder=str(tmp_path))
    require_writable(wanted)
    not_permitted(monkeypatch, tmp_path)
    monkeypatch.setattr(Path, "owner", lambda _: "dauam")
    typed = ["/usr/local/bin/companion", "preflight", "--by-hand", "--config", "/etc/dauam/my file.toml"]
    monkeypatch.setattr("sys.argv", typed)
    with pytest.raises(ConfigError) as refused:
        require_writable(wanted)
    assert str(refused.value) == (
        f"cannot keep that the vehicle was carried in {tmp_path}/by_hand.json (preflight.state_folder): it belongs to "
        "the vehicle's service; carry it as that user: `sudo -u dauam -H /usr/local/bin/companion preflight --by-hand "
        "--config '/etc/dauam/my file.toml'`"
    )


def test_a_vehicles_state_folder_on_another_computer_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = PreflightConfig(state_folder=str(tmp_path / "var" / "lib"))
    require_writable(wanted)
    not_permitted(monkeypatch, tmp_path)
    with pytest.raises(
        ConfigError, match=r"var/lib is not there and cannot be made by this user; run this on the vehicle"
    ):
        require_writable(wanted)
