"""`companion mocap-bridge` as a user meets it."""

import math
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from companion.cli.commands import app
from companion.cli.vehicle import mocap_bridge
from companion.cli.vehicle.mocap_bridge import line_of
from companion.core.interfaces import ConfigError
from companion.service.mocap_bridge import Glance
from tests.adapters.qualisys.rig import capturing, serving
from tests.broker import broker
from tests.flights.command import run, start

GOOD = Glance(frames=500, sent=498, age_s=0.004, dropped=2, passed_over=1, tracked=True, trouble="")


@pytest.mark.parametrize(
    ("glance", "line"),
    [
        (GOOD, "100.0 frames/s, newest 4 ms old; dropped 2 from QTM, 1 for the broker"),
        (
            Glance(
                frames=0, sent=0, age_s=math.inf, dropped=0, passed_over=0, tracked=False, trouble="no QTM at here:1"
            ),
            "100.0 frames/s, none yet: no QTM at here:1; dropped 0 from QTM, 0 for the broker",
        ),
        (
            Glance(frames=9, sent=9, age_s=12.3, dropped=0, passed_over=0, tracked=False, trouble=""),
            "100.0 frames/s, newest 12 s old, body not tracked; dropped 0 from QTM, 0 for the broker",
        ),
    ],
)
def test_the_line(glance: Glance, line: str) -> None:
    assert line_of(glance, 100.0) == line


def test_where_lines_are_kept_there_is_one_for_news_and_one_a_minute(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = mocap_bridge._Writer()
    for second in range(130):
        write(f"at {second} s", "" if second < 100 else "trouble")
    assert capsys.readouterr().out.split("\n")[:-1] == ["at 0 s", "at 60 s", "at 100 s"]
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    write("a", "")
    write("b", "")
    assert capsys.readouterr().out == "\r\x1b[Ka\r\x1b[Kb"


def test_a_configuration_without_mqtt_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "lab.toml"
    config.write_text('[mocap]\nbody = "dauam"\n')
    error = CliRunner().invoke(app, ["mocap-bridge", "--config", str(config)]).exception
    assert isinstance(error, ConfigError)
    assert 'mocap.source = "qualisys"' in str(error)


def configured(folder: Path, qtm: int, port: int, body: str = "dauam") -> Path:
    file = folder / f"{body}.toml"
    file.write_text(f'[mocap]\nsource = "mqtt"\nport = {qtm}\nbody = "{body}"\n[mocap.broker]\nport = {port}\n')
    return file


@pytest.mark.realtime
async def test_it_forwards_tells_what_is_wrong_refuses_a_second_one_and_ends_well(tmp_path: Path) -> None:
    with broker() as server:
        async with serving() as qtm, capturing(qtm):
            bridge = await start("mocap-bridge", "--config", configured(tmp_path, qtm.port, server.port))
            await bridge.until_line("from QTM, ")
            second = await run("mocap-bridge", "--config", configured(tmp_path, qtm.port, server.port, "wand"))
            assert second.code == 2, second.said
            assert "forwards this vehicle already" in second.err
            assert "does not know the body 'wand'; it has: dauam" in second.said
            bridge.interrupt()
            ran = await bridge.ended()
    assert ran.code == 0, ran.said
    assert "Traceback" not in ran.said + second.said
