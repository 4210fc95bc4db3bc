"""The [separation] table: what it refuses, and who the others are."""

import json
from pathlib import Path
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.toml_files import validate
from companion.core.errors import ConfigError

FILE = Path("lab.toml")
OWN = {"mocap": {"body": "a"}}


def config(**tables: dict[str, Any]) -> CompanionConfig:
    return validate(CompanionConfig, json.loads(json.dumps(tables)), FILE)


def test_without_the_table_there_are_no_others() -> None:
    assert config().separation.others_than("dauam") == ()


def test_the_others_are_all_but_the_own_body_in_order() -> None:
    separation = config(separation={"order": ["c", "a", "b"]}, **OWN).separation
    assert separation.others_than("a") == ("c", "b")


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ({"separation": {"order": ["b", "c"]}}, "must contain mocap.body = 'a'"),
        ({"separation": {"order": ["a", "b", "a"]}}, "order has 'a' twice"),
        ({"separation": {"order": ["a", ""]}}, "order has an empty name"),
        ({"separation": {"order": ["a"]}}, "order names one vehicle"),
        ({"separation": {"radius_m": 0.1}}, "separation.radius_m = 0.1"),
        (
            {"separation": {"order": ["a", "b"]}, "mocap": {"body": "a", "source": "mqtt", "broker": {"host": "b"}}},
            "the bridge forwards this vehicle's body alone",
        ),
    ],
)
def test_a_table_that_cannot_keep_vehicles_apart_is_refused_in_one_sentence(
    tables: dict[str, dict[str, Any]], sentence: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        config(**(OWN | tables))
    assert sentence in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_vehicle_without_frames_is_refused_as_it_would_see_nobody(tmp_path: Path) -> None:
    key = tmp_path / "law.key"
    key.write_text("0123456789abcdef\n")
    key.chmod(0o600)
    law = {"runs_on": "ground", "onboard_mocap": False, "link": {"key_file": str(key)}}
    assert not config(law=law).separation.order
    with pytest.raises(ConfigError, match="leaves the others unseen"):
        config(separation={"order": ["a", "b"]}, law=law, **OWN)
