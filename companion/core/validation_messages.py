"""Messages for wrong values in a file or a command, made from those of pydantic; imports nothing heavy."""

import difflib
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_NUMBER, _WHOLE, _TEXT = "must be a number", "must be a whole number", "must be text in quotes"
_TABLE, _LIST = "must be a table", "must be a list of values, as [1.0, 2.0]"
_KINDS = {
    "float_type": _NUMBER,
    "float_parsing": _NUMBER,
    "int_type": _WHOLE,
    "int_parsing": _WHOLE,
    "int_from_float": _WHOLE,
    "int_parsing_size": "is too large for a whole number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": _TEXT,
    "list_type": _LIST,
    "tuple_type": _LIST,
    "dict_type": _TABLE,
    "model_type": _TABLE,
    "model_attributes_type": _TABLE,
    "dataclass_type": _TABLE,
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "string_too_long": "must have at most {max_length} characters",
    "extra_forbidden": "unknown key",
    "missing": "is missing",
}


def plain(detail: "ErrorDetails") -> str:
    """Return the message for one pydantic error: what is allowed, without the key and the value."""
    kind, said, context = detail["type"], detail["msg"], detail.get("ctx", {})
    if kind in {"literal_error", "enum"}:
        return f"must be {context['expected']}{_near(detail.get('input'), context['expected'])}"
    if kind == "string_too_short":
        return "must not be empty" if context["min_length"] == 1 else f"needs {context['min_length']} characters"
    if kind == "string_pattern_mismatch":
        return _letters(context["pattern"])
    if kind in {"too_long", "too_short"}:
        return _count(kind, context)
    if kind in _KINDS:
        hint = ", without quotes" if _KINDS[kind] in {_NUMBER, _WHOLE} and _is_number(detail.get("input")) else ""
        return _KINDS[kind].format(**context) + hint
    said = said.removeprefix("Value error, ")
    return said[:1].lower() + said[1:]


def _count(kind: str, context: dict[str, Any]) -> str:
    most = context.get("max_length", context.get("min_length"))
    than = "at most" if kind == "too_long" else "at least"
    return f"must have {than} {most} values, it has {context['actual_length']}"


def _letters(pattern: str) -> str:
    """Describe a pattern such as ^[a-z]{1,64}$ in words."""
    parts = re.fullmatch(r"\^\[(.+)\]\{(\d+)(?:,(\d+))?\}\$", pattern)
    if parts is None:
        return f"must match {pattern}"
    letters, least, most = parts.groups()
    return f"must be {least}{f' to {most}' if most else ''} characters of {letters}"


def _near(given: object, expected: str) -> str:
    """Return the suggestion of the choice most similar to `given`, or an empty string."""
    choices = expected.split("'")[1::2]
    near = difflib.get_close_matches(given.lower(), choices, n=1) if isinstance(given, str) else []
    return f", did you mean '{near[0]}'?" if near and len(choices) > 1 else ""


def _is_number(given: object) -> bool:
    """Return True for a text that reads as a number."""
    try:
        return isinstance(given, str) and bool(float(given) or True)
    except ValueError:
        return False
