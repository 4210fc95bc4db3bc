"""docs/configuration.md names every key that a file may have, and says what it means."""

from pathlib import Path

import pytest

from companion.config.arm_files import MOTIONS
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import PEERS, EtnnFile, OwnLawFile, PidFile
from companion.config.preflight_config import Recommended
from companion.simulation.scene import ExperimentFile
from mock_autopilot.config import MockConfig
from tests.config.reference_page import page, tables

DOCS = Path(__file__).resolve().parents[2] / "docs"
FILES = [
    CompanionConfig,
    EtnnFile,
    PidFile,
    *(model for model, _ in PEERS.values()),
    OwnLawFile,
    ExperimentFile,
    Recommended,
    MockConfig,
    *MOTIONS.values(),
]


def test_the_page_is_printed_from_the_models() -> None:
    command = "run python -m tests.config.reference_page > docs/configuration.md"
    assert (DOCS / "configuration.md").read_text(encoding="utf-8") == page(), command


@pytest.mark.parametrize("model", FILES, ids=lambda model: model.__name__)
def test_every_table_and_every_key_has_a_meaning(model: type) -> None:
    for table in tables(model):
        assert table.meaning, table.names
        for key in table.keys:
            assert len(key.meaning) > 8, f"{table.names} {key.name}: {key.meaning!r}"


def test_a_row_says_type_unit_default_range_and_meaning() -> None:
    (vehicle,) = [table for table in tables(CompanionConfig) if table.names == ("vehicle",)]
    assert vehicle.keys[0] == ("mass_kg", "number, kg", "`4.85`", "> 0.1, ≤ 50", "Total mass m_t with both arms.")


def test_tables_of_tables_are_named_as_in_a_file() -> None:
    names = [name for table in tables(CompanionConfig) for name in table.names]
    assert {"arms.servos.NAME", "[arms.links]", "mocap.broker", "operator", "records"} <= set(names)
    mock = [table.names for table in tables(MockConfig)]
    assert ("plant",) in mock
    assert ("[qualisys.outages]", "[qualisys.silences]") in mock
