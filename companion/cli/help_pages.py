"""Pages of --help in plain text: quick to print, whole at 80 columns, and without markup that eats [tables]."""

import re
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

Rows = dict[str, list[tuple[str, str]]]
_WIDEST_CHOICES = 18
_TYPE = re.compile(r" ?<(?P<shown>[^<>]+)>")
"""The type of a value as typer prints it."""
_TYPES = {
    "float": "NUMBER",
    "float range": "NUMBER",
    "int": "INTEGER",
    "int range": "INTEGER",
    "str": "TEXT",
    "path": "PATH",
    "list[str]": "TEXT",
    "list[path]": "PATH",
}
_RANGES = (
    (re.compile(r"(\S+)<=x<=([^\s\]]+)"), r"\1 to \2"),
    (re.compile(r"x>=([^\s\]]+)"), r"at least \1"),
    (re.compile(r"x<=([^\s\]]+)"), r"at most \1"),
)


class HelpCommand(TyperCommand):
    """A command whose --help lists its options by panel and ends with examples."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words after the command's name in its usage line."""
        return ["[OPTIONS]", *(_argument_name(one) for one in self.get_params(ctx) if _is_argument(one))]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments and options, a section for each panel."""
        _write(formatter, _parameter_rows(self, ctx))

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 - a method of click's
        """Write the examples, a line each."""
        _write_examples(formatter, self.epilog)


class HelpGroup(TyperGroup):
    """A group whose --help lists its commands by panel, a line each."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands and options, a section for each panel."""
        rows: Rows = {}
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None) or "Commands"
            rows.setdefault(panel, []).append((name, command.help or ""))
        _write(formatter, rows | _parameter_rows(self, ctx))

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 - a method of click's
        """Write the examples, a line each."""
        _write_examples(formatter, self.epilog)


def _parameter_rows(command: Any, ctx: Any) -> Rows:
    rows: Rows = {}
    for parameter in command.get_params(ctx):
        record = parameter.get_help_record(ctx)
        if record is None:
            continue
        argument = _is_argument(parameter)
        panel = getattr(parameter, "rich_help_panel", None) or ("Arguments" if argument else "Options")
        shown, choices = _plain_type(_argument_name(parameter) if argument else record[0], record[0])
        rows.setdefault(panel, []).append((shown, _plain_ranges(record[1]) + choices))
    return rows


def _write(formatter: Any, rows: Rows) -> None:
    for panel, lines in rows.items():
        with formatter.section(typer.style(panel, bold=True)):
            formatter.write_dl(lines)


def _write_examples(formatter: Any, epilog: str | None) -> None:
    if epilog:
        with formatter.section(typer.style("Examples", bold=True)):
            for line in epilog.splitlines():
                formatter.write(f"{'':>{formatter.current_indent}}{line}\n")


def _is_argument(parameter: Any) -> bool:
    return bool(parameter.param_type_name == "argument")


def _argument_name(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    if parameter.nargs == -1 and not name.endswith("..."):
        name += "..."
    return name if parameter.required else f"[{name}]"


def _plain_type(name: str, record: str) -> tuple[str, str]:
    """Return `name` with its type in plain words, and the sentence of the choices that this does not show."""
    found = _TYPE.search(record)
    if found is None:
        return name, ""
    choices = found["shown"].split("|")
    sentence = f"  One of: {', '.join(choices)}."
    option = name == record
    if len(choices) == 1:
        return (_TYPE.sub(f" {_TYPES.get(found['shown'], 'VALUE')}", name) if option else name), ""
    if option and len(found["shown"]) <= _WIDEST_CHOICES:
        return _TYPE.sub(f" {found['shown']}", name), ""
    return (_TYPE.sub(" NAME", name) if option else name), sentence


def _plain_ranges(text: str) -> str:
    for found, plain in _RANGES:
        text = found.sub(plain, text)
    return text
