"""The schemas that stand in docs/ are those of the models."""

import json

import pytest

from companion.protocol.schema import FOLDER, printed
from tests.protocol.payloads import GOOD


@pytest.mark.parametrize(("name", "text"), printed().items())
def test_the_printed_schemas_are_up_to_date(name: str, text: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == text, "run python -m companion.protocol.schema"


def test_there_is_no_schema_of_what_there_is_no_more() -> None:
    assert {path.name for path in FOLDER.iterdir()} == set(printed())


def test_the_commands_schema_tells_the_verbs_apart() -> None:
    assert set(json.loads(printed()["command.schema.json"])["discriminator"]["mapping"]) == set(GOOD)
