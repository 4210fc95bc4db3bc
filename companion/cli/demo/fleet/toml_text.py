"""Configurations as the text of a TOML file, for programs that write one for another program."""

import json
from collections.abc import Mapping
from typing import Any


def toml_of(data: Mapping[str, Any]) -> str:
    """Return TOML with a table for each mapping at the top level; values inside are on one line, None is left out."""
    plain = {name: value for name, value in data.items() if not isinstance(value, Mapping) and value is not None}
    tables = {name: value for name, value in data.items() if isinstance(value, Mapping)}
    lines = [f"{name} = {_value(value)}" for name, value in plain.items()]
    for name, table in tables.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items() if one is not None) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return repr(value)  # inf and nan are TOML's words, too
    return json.dumps(value, ensure_ascii=False)


def _key(key: Any) -> str:
    return json.dumps(str(key), ensure_ascii=False)
