"""The configuration and the control laws of a record."""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import controller_text
from companion.config.flight_config import LawConfig, LawLinkConfig
from companion.config.toml_files import validate
from companion.control.controller import Controller
from companion.control.remote_law import RemoteLaw
from companion.core.interfaces import ConfigError
from companion.flight.assembly import controller_of, with_link
from companion.records.read import FlightRecord, RecordedTick, RecordError

_WITH_SECRETS = frozenset({"operator", "law"})
"""Tables that name files with passwords and keys, which are not in the record."""


def config_of(record: FlightRecord) -> CompanionConfig:
    """Return the configuration in force; RecordError where the record has none, ConfigError where it is foreign."""
    data = record.metadata.get("config")
    if not isinstance(data, dict):
        raise RecordError(f"{record.path}: has no configuration: too old for this, or not written by the service")
    without_files = {name: value for name, value in data.items() if name not in _WITH_SECRETS}
    config = validate(CompanionConfig, without_files, record.path, "config")
    return config.model_copy(update={"law": _law_table(data.get("law"), record.path)})


def _law_table(data: object, path: Path) -> LawConfig:
    """Return the place of the law without its key, which is not on this computer."""
    if not isinstance(data, dict):
        return LawConfig()
    link = {name: value for name, value in dict(data.get("link") or {}).items() if name != "key_file"}
    return LawConfig.model_construct(
        runs_on="ground" if data.get("runs_on") == "ground" else "onboard",
        onboard_mocap=data.get("onboard_mocap", True) is not False,
        link=validate(LawLinkConfig, link, path, "config.law.link"),
    )


@dataclass(frozen=True)
class LawKey:
    """Law as it was made: its name, and on the ground the age (s) of the uplink that it was made for; there else 0."""

    name: str
    up_age_s: float = 0.0


def key_of(tick: RecordedTick) -> LawKey:
    """Return the law that was in charge."""
    return LawKey(tick.law, 0.0 if math.isnan(tick.made_for_s) else tick.made_for_s)


def laws_of(record: FlightRecord, config: CompanionConfig) -> dict[LawKey, Controller]:
    """Return the laws that flew; ConfigError or RecordError when one cannot be loaded any more.

    In the record of a vehicle, laws on the ground are one RemoteLaw, which gives the recorded commands again.
    """
    columns = record.columns
    if "law_name" not in columns:
        raise RecordError(
            f"{record.path}: does not say which law flew: too old a record, or one of `companion simulate`"
        )
    keys = _keys(record)
    if not keys and record.law_flew:
        raise RecordError(f"{record.path}: does not say which law flew: too old a record for a replay")
    if "link_command" in columns:
        return dict.fromkeys(keys, RemoteLaw())
    if config.law.on_ground and not record.is_of_ground:
        raise RecordError(f"{record.path}: has no commands of the law on the ground: too old a record for a replay")
    texts: dict[str, str] = record.metadata.get("laws", {})
    return {key: law_of(key.name, texts.get(key.name), with_link(config, key.up_age_s)) for key in keys}


def _keys(record: FlightRecord) -> list[LawKey]:
    names = record.columns["law_name"]
    ages_s = np.nan_to_num(record.columns.get("link_made_for_s", np.zeros(len(names))))
    flown = names != ""
    if record.is_of_ground:  # on the ground the law is made anew whenever its uplink's age has changed
        flown &= np.isfinite(record.columns.get("given_dt_s", np.full(len(names), np.nan)))
    pairs = sorted(set(zip(names[flown].tolist(), ages_s[flown].tolist(), strict=True)))
    return [LawKey(str(name), float(age_s)) for name, age_s in pairs]


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
