"""TOML files into strict models, and what is wrong with them into sentences."""

import difflib
import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from companion.config.text_files import read_text
from companion.core.errors import ConfigError
from companion.core.validation_messages import plain

Model = TypeVar("Model", bound=BaseModel)


class Section(BaseModel):
    """A table of a configuration file: frozen, and a key it does not know is an error."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a file's tables; ConfigError with one sentence when it is missing or not TOML."""
    return tables_of(read_text(path), path)


def tables_of(text: str, path: Path) -> dict[str, Any]:
    """Return the tables of the text of the file at `path`; ConfigError with one sentence when it is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def validate(model: type[Model], data: dict[str, Any], path: Path, under: str = "") -> Model:
    """Return `data` as `model`; ConfigError with file, key, value and remedy for each mistake.

    By way of JSON, because there a strict model takes an array for a tuple; TOML has no tuples either.
    """
    try:
        return model.model_validate_json(json.dumps(data, default=_no_such_value))
    except ValidationError as error:
        lines = dict.fromkeys(_sentence(detail, model, under) for detail in error.errors())
        raise ConfigError("\n".join(f"{path}: {line}" for line in lines)) from error


def _no_such_value(value: object) -> dict[str, str]:
    """Return TOML's dates and times, which no key has, as a table, so that no model takes them for text."""
    return {type(value).__name__: str(value)}


def _sentence(detail: ErrorDetails, model: type[BaseModel], under: str) -> str:
    parts = [str(part) for part in detail["loc"]]
    key = ".".join([under, *parts] if under else parts)
    if detail["type"] == "extra_forbidden":
        return f"{key}: unknown key{_suggestion(model, parts)}"
    if detail["type"] == "missing" and isinstance(detail["input"], list):
        key = key.rpartition(".")[0]
        return f"{key} = {_toml(detail['input'])}: {len(detail['input'])} values are too few"
    said = plain(detail)
    if detail["type"] in {"model_type", "dict_type"}:
        return f"{key} = {_toml(detail['input'])}: {said} [{key}]"
    if not key:
        return said
    return f"{key}: {said}" if isinstance(detail["input"], dict) else f"{key} = {_toml(detail['input'])}: {said}"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, list) else repr(value)


def _suggestion(model: type[BaseModel], parts: list[str]) -> str:
    """Return the nearest key of the table that has the unknown one."""
    table: Any = model
    for part in parts[:-1]:
        table = table.model_fields[part].annotation if part in getattr(table, "model_fields", {}) else None
    known = sorted(getattr(table, "model_fields", {}))
    near = difflib.get_close_matches(parts[-1], known, n=1)
    if near:
        return f", did you mean {near[0]!r}?"
    return f"; known here are {', '.join(known)}" if known else ""
