"""Reference of all configuration keys: `python -m tests.config.reference_page > docs/configuration.md`."""

import ast
import dataclasses
import inspect
import math
import textwrap
from collections.abc import Iterator
from enum import Enum
from itertools import pairwise
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from companion.config.arm_files import MOTIONS
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import PEERS, EtnnFile, OwnLawFile, PidFile
from companion.config.preflight_config import Recommended
from companion.simulation.scene import ExperimentFile
from mock_autopilot.config import MockConfig

HEAD = """# Every key of every configuration file

Printed from the models by `python -m tests.config.reference_page > docs/configuration.md`; a test compares them.

Files are TOML, in UTF-8. A key that is unknown or out of its range is refused with a sentence that names it; what a
file leaves out has its default. Numbers may be written without a point; `nan` and `inf` are none. Units stand
behind the type; W is the room's frame (right-handed, z up), body axes are FLU (forward, left, up).

Commands for a vehicle that are given no `--config` read `/etc/dauam/companion.toml` where the service is installed,
else `config/lab.toml`, and say so in their first line. `demo` and `simulate --demo` read `config/demo.toml` and
`config/mock.toml`.
"""
_UNITS = {
    "m": "m", "s": "s", "mps": "m/s", "mps2": "m/s²", "rad": "rad", "radps": "rad/s", "radps2": "rad/s²", "kg": "kg",
    "kgm2": "kg m²", "n": "N", "npm": "N/(m/s)", "npm2": "N/(m/s)²", "hz": "Hz", "v": "V", "c": "°C", "mb": "MB",
    "h": "h", "us": "µs", "days": "days", "ps": "1/s",
}  # fmt: skip
_PLAIN = {
    float: "number",
    int: "whole number",
    bool: "true or false",
    str: "text",
    np.ndarray: "numbers",
    dict: "a table of its own",
}
_COLUMNS = ("| key | type, unit | default | range | meaning |", "| --- | --- | --- | --- | --- |")
_SAID = {"kg m^2": "kg m²", "m/s^2": "m/s²", "rad/s^2": "rad/s²", "microseconds": "µs", "degrees C": "°C"}


class Key(NamedTuple):
    """One row of the page."""

    name: str
    kind: str
    default: str
    range: str
    meaning: str


class Table(NamedTuple):
    """One table of a file."""

    names: tuple[str, ...]
    """Names in the file's brackets; empty for keys outside of any table."""
    meaning: str
    keys: tuple[Key, ...]


def tables(model: type, names: tuple[str, ...] = ("",)) -> Iterator[Table]:
    """Yield a model's own keys and its nested tables, in the models' order; tables of one model are merged."""
    keys: list[Key] = []
    inner: dict[type, list[str]] = {}
    for key, field in _fields(model).items():
        nested = [each for each in _models_in(field.annotation) if each is not CompanionConfig]
        for each in nested:
            paths = [_path(f"{name}.{key}".removeprefix("."), field.annotation) for name in names]
            inner.setdefault(each, []).extend(paths)
        if not nested or _collection(field.annotation):
            keys.append(_key(key, field, nested))
    if keys:
        yield Table(names, " ".join((model.__doc__ or "").partition("\n\n")[0].split()), tuple(keys))
    for each, paths in inner.items():
        yield from tables(each, tuple(paths))


def _key(name: str, field: FieldInfo, nested: list[type]) -> Key:
    unit = next((_UNITS[part] for part in reversed(name.split("_")[1:]) if part in _UNITS), "")
    kind = "tables" if nested else _kind(field.annotation)
    meaning = field.description or ""
    for said in (unit, *(plain for plain, nice in _SAID.items() if nice == unit)):
        meaning = meaning.removesuffix(".").removesuffix(f", {said}") if said else meaning
    return Key(name, f"{kind}, {unit}" if unit else kind, _default(field, nested), _range(field), _sentence(meaning))


def _fields(model: type) -> dict[str, FieldInfo]:
    """Return the keys of a model, or of a dataclass with the docstrings below its attributes as descriptions."""
    if issubclass(model, BaseModel):
        return dict(model.model_fields)
    hints, said, fields = get_type_hints(model, include_extras=True), _docstrings(model), {}
    for item in dataclasses.fields(model):  # type: ignore[arg-type]
        fields[item.name] = FieldInfo.from_annotated_attribute(hints[item.name], item.default)
        fields[item.name].description = said.get(item.name)
    return fields


def _docstrings(model: type) -> dict[str, str]:
    """Return the docstrings below a class's attributes, by attribute."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    assert isinstance(body, ast.ClassDef)
    said = {}
    for line, after in pairwise(body.body):
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and isinstance(after, ast.Expr):
            said[line.target.id] = inspect.cleandoc(str(getattr(after.value, "value", ""))).replace("\n", " ")
    return said


def _models_in(annotation: Any) -> Iterator[type]:
    if isinstance(annotation, type) and (issubclass(annotation, BaseModel) or dataclasses.is_dataclass(annotation)):
        yield annotation
    else:
        yield from dict.fromkeys(one for each in get_args(annotation) for one in _models_in(each))


def _collection(annotation: Any) -> bool:
    return get_origin(annotation) in {dict, tuple, list} or any(map(_collection, get_args(annotation)))


def _path(path: str, annotation: Any) -> str:
    """Return the brackets of a table: [x], [[x]] for a list of tables, [x.NAME] for tables by name."""
    origins = {get_origin(annotation), *(get_origin(inner) for inner in get_args(annotation))}
    if dict in origins:
        return f"{path}.NAME"
    return f"[{path}]" if origins & {tuple, list} else path


def _kind(annotation: Any) -> str:
    origin, inner = get_origin(annotation), [one for one in get_args(annotation) if one is not type(None)]
    kind = _PLAIN.get(origin or annotation, "tables")
    if origin is Annotated:
        kind = _kind(inner[0])
    elif origin is Literal:
        kind = _choices(inner)
    elif isinstance(annotation, type) and issubclass(annotation, Enum):
        kind = _choices([choice.value for choice in annotation])
    elif origin in {tuple, list}:
        count = "" if origin is list or inner[-1] is Ellipsis else f"{len(inner)} "
        kind = f"{count}{_kind(inner[0])}s"
    elif origin in {Union, UnionType}:
        kind = " or ".join(dict.fromkeys(map(_kind, inner)))
    return kind


def _choices(values: list[Any]) -> str:
    return " or ".join(f'`"{value}"`' for value in values)


def _default(field: FieldInfo, nested: list[type]) -> str:
    if field.is_required() or field.default is dataclasses.MISSING:
        return "must be given"
    value = field.get_default(call_default_factory=True, validated_data={})
    if nested:
        return "see the example" if value else "none"
    if isinstance(value, BaseModel):
        return "see the example"
    if isinstance(value, float) and math.isinf(value):
        return "for ever"
    return "none" if value is None else f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Enum):
        return f'"{value.value}"'
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "{ }"
    if isinstance(value, tuple | list | np.ndarray):
        return f"[{', '.join(map(_toml, value))}]"
    return _number(value) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    turns = {math.pi: "π", -math.pi: "-π", 2.0 * math.pi: "2π"}
    return next((name for turn, name in turns.items() if math.isclose(value, turn)), f"{value:.10g}")


def _range(field: FieldInfo) -> str:
    marks = [(Gt, "gt", "> "), (Ge, "ge", "≥ "), (Lt, "lt", "< "), (Le, "le", "≤ ")]
    bounds = [
        f"{sign}{_number(getattr(limit, name))}"
        for kind, name, sign in marks
        for limit in field.metadata
        if isinstance(limit, kind)
    ]
    return ", ".join(bounds)


def _sentence(text: str) -> str:
    text = text.strip().removesuffix(".").replace("|", "\\|")
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def chapter(title: str, said: str, model: type) -> str:
    """Return the chapter about one kind of file: its title, a sentence, its tables."""
    parts = [f"## {title}", said]
    for table in tables(model):
        head = f"### {', '.join(f'`[{name}]`' for name in table.names)}" if any(table.names) else "### First lines"
        rows = [f"| `{key.name}` | {key.kind} | {key.default} | {key.range} | {key.meaning} |" for key in table.keys]
        parts += [head, table.meaning, "\n".join([*_COLUMNS, *rows])]
    return "\n\n".join(parts)


def page() -> str:
    """Return docs/configuration.md as one string."""
    chapters = [
        chapter("The companion", "`config/lab.toml` and `config/demo.toml` are examples.", CompanionConfig),
        chapter("Control laws", 'Files of `config/controllers/`; those with `law = "etnn"`.', EtnnFile),
        chapter('Control laws: `law = "pid"`', "As above, with other gains.", PidFile),
        *(
            chapter(f'Control laws: `law = "{law}"`', "[peers.md](peers.md).", model)
            for law, (model, _) in PEERS.items()
        ),
        chapter("Control laws of your own", "[own-law.md](own-law.md).", OwnLawFile),
        *(
            chapter(f'Motions of the arms: `kind = "{kind}"`', "Files of `config/arms/`.", model)
            for kind, model in MOTIONS.items()
        ),
        chapter("Experiments", "Files of `config/experiments/`, [experiments.md](experiments.md).", ExperimentFile),
        chapter("PX4's parameters", "`config/px4/recommended.toml`: a table for each parameter.", Recommended),
        chapter("The mock", "`config/mock.toml` is the example. World NED, body FRD, as the autopilot's.", MockConfig),
    ]
    return "\n\n".join([HEAD.strip(), *chapters]) + "\n"


if __name__ == "__main__":
    print(page(), end="")
