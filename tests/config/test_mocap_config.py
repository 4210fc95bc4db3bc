"""Sources of frames in the configuration, and settings that do not fit together."""

import json
from pathlib import Path
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.toml_files import validate
from companion.core.interfaces import ConfigError

FILE = Path("lab.toml")


def config(**tables: dict[str, Any]) -> CompanionConfig:
    return validate(CompanionConfig, json.loads(json.dumps(tables)), FILE)


def test_qtm_itself_is_the_usual_source() -> None:
    assert config().mocap.source == "qualisys"


def test_the_operators_broker_is_used_unless_there_is_another() -> None:
    operator = {"host": "broker", "vehicle": "dauam-1"}
    usual = config(mocap={"source": "mqtt"}, operator=operator)
    assert usual.mocap_broker() == usual.operator
    room = config(mocap={"source": "mqtt", "broker": {"host": "room", "vehicle": "dauam-1"}}, operator=operator)
    assert (room.mocap_broker().host, room.mocap_broker().table) == ("room", "mocap.broker")
    assert room.mocap_broker().topics.mocap == "dauam/v1/dauam-1/mocap"


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"mocap": {"source": "mqtt"}}, 'mocap.source = "mqtt": over which broker? Give [operator], or [mocap.broker]'),
        (
            {"mocap": {"source": "mqtt"}, "operator": {"embedded": True}},
            "the embedded broker of [operator] is for this computer alone",
        ),
        ({"mocap": {"broker": {"host": "room"}}}, 'give source = "mqtt" as well, or no [mocap.broker]'),
        (
            {"mocap": {"source": "mqtt", "broker": {"embedded": True}}},
            "mocap.broker: embedded is for [operator] alone",
        ),
        (
            {"mocap": {"source": "mqtt", "broker": {"host": "room"}}, "operator": {"vehicle": "dauam-1"}},
            "mocap.broker: its topics begin with dauam/v1/vehicle, those of [operator] with dauam/v1/dauam-1",
        ),
        ({"mocap": {"port": 22222}}, "mocap.port = 22222: 22222 is QTM's port for version 1.0 of its protocol"),
        ({"mocap": {"port": 22224}}, "QTM's port for big endian: give the one for little endian, 22223"),
        ({"mocap": {"source": "vicon"}}, "mocap.source = 'vicon': must be 'qualisys' or 'mqtt'"),
        ({"mocap": {"source": "mqtt", "broker": {"hots": "room"}}}, "mocap.broker.hots: unknown key"),
    ],
)
def test_what_does_not_fit_together_is_one_sentence(tables: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as error:
        config(**tables)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_a_login_that_cannot_be_read_is_named_by_its_table(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("")
    secret.chmod(0o600)
    broker = {"user": "mocap-bridge", "password_file": str(secret)}
    with pytest.raises(ConfigError, match=r"^mocap\.broker\.password_file = "):
        config(mocap={"source": "mqtt", "broker": broker}).mocap_broker().password()
