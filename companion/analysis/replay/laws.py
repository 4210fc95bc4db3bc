"""The configuration and the control laws of a record."""

import tempfile
from pathlib import Path

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_text
from companion.config.toml_files import validate
from companion.control.controller import Controller
from companion.control.remote_law import RemoteLaw
from companion.core.interfaces import ConfigError
from companion.flight.assembly import controller_of
from companion.records.read import FlightRecord, RecordError


def config_of(record: FlightRecord) -> CompanionConfig:
    """Return the configuration in force; RecordError where the record has none, ConfigError where it is foreign."""
    data = record.metadata.get("config")
    if not isinstance(data, dict):
        raise RecordError(f"{record.path}: has no configuration: too old for this, or not written by the service")
    without_files = {name: value for name, value in data.items() if name != "operator"}  # its passwords are not here
    return validate(CompanionConfig, without_files, record.path, "config")


def laws_of(record: FlightRecord, config: CompanionConfig) -> dict[str, Controller]:
    """Return the laws that flew, by name; ConfigError or RecordError when one cannot be loaded any more.

    Laws on the ground are one RemoteLaw, which gives the recorded commands again.
    """
    columns = record.columns
    if "law_name" not in columns:
        raise RecordError(
            f"{record.path}: does not say which law flew: too old a record, or one of `companion simulate`"
        )
    names = sorted({str(name) for name in np.unique(columns["law_name"]) if name})
    if not names and record.law_flew:
        raise RecordError(f"{record.path}: does not say which law flew: too old a record for a replay")
    if "link_command" in columns:
        return dict.fromkeys(names, RemoteLaw())
    if config.law.on_ground:
        raise RecordError(f"{record.path}: has no commands of the law on the ground: too old a record for a replay")
    texts: dict[str, str] = record.metadata.get("laws", {})
    return {name: law_of(name, texts.get(name), config) for name in names}


def law_of(name: str, text: str | None, config: CompanionConfig) -> Controller:
    """Return the law of a controller file's text, or else of the file of that name; RecordError if it is foreign."""
    if text is None or _is_same(name, text):
        return controller_of(config, name, allow_unstable=True).law
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{Path(name).stem}.toml"
        path.write_text(text, encoding="utf-8")
        try:
            return controller_of(config, str(path), allow_unstable=True).law
        except ConfigError as error:
            why = str(error).removeprefix(f"{path}: ")
            raise RecordError(f"the law {name!r} as it flew cannot be had in this version: {why}") from error


def _is_same(name: str, text: str) -> bool:
    """Return True if the file has this text; then a law's own Python file is found beside it."""
    try:
        return controller_text(name) == text
    except ConfigError:
        return False
