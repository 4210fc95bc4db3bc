"""Messages for wrong values in the mock's settings: pydantic's errors in the words of the TOML file."""

from pydantic_core import ErrorDetails

_KINDS = {
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list of values, as [1.0, 2.0]",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "dataclass_type": "must be a table",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_long": "must have at most {max_length} values, it has {actual_length}",
    "too_short": "must have at least {min_length} values, it has {actual_length}",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "missing": "is missing",
}


def sentence(detail: ErrorDetails) -> str:
    """Return one sentence with the key, its value and the reason why it is wrong."""
    where, given = ".".join(str(part) for part in detail["loc"]), detail["input"]
    if detail["type"] in {"extra_forbidden", "unexpected_keyword_argument"}:
        return f"{where}: unknown key"
    if detail["type"] == "missing" and isinstance(given, list | tuple):
        return f"{where.rpartition('.')[0]} = {given!r}: {len(given)} values are too few"
    words = _KINDS.get(detail["type"])
    said = detail["msg"].removeprefix("Value error, ") if words is None else words.format(**detail.get("ctx", {}))
    if not where:
        return said
    plain = isinstance(given, str | int | float | list | tuple)
    return f"{where} = {given!r}: {said}" if plain else f"{where}: {said}"
