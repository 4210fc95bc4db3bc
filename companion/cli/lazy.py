"""Groups of commands whose modules are imported only when one of them runs or prints its own --help."""

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from types import ModuleType
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup

from companion.cli.help_pages import HelpCommand, HelpGroup

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@dataclass(frozen=True)
class Command:
    """Entry of one command: `place` is MODULE:FUNCTION in companion.cli, `summary` its line in the list of commands."""

    place: str
    summary: str
    examples: tuple[str, ...] = ()
    """Command lines for its --help, without the leading `companion`."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Further settings of click's context."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """Entry of a group of commands, in `panels` as its --help lists them."""

    summary: str
    about: str
    """Text of its --help, below the usage line."""
    panels: Mapping[str, Mapping[str, "Command | Group"]]
    examples: tuple[str, ...] = ()


Prepare = Callable[[], None]


class LazyGroup(HelpGroup):
    """The commands of `entry`, none of them imported."""

    entry: ClassVar[Group]
    before_command: ClassVar[Prepare] = staticmethod(lambda: None)
    """Called once the command that runs has been imported."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = {
            name: HelpCommand(name, help=entry.summary, rich_help_panel=panel)
            for panel, entries in self.entry.panels.items()
            for name, entry in entries.items()
        }

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that runs or prints its --help; only its module is imported.

        A name of two words is tried first, as `records merge`.
        """
        if " ".join(args[:2]) in self.commands:
            args = [" ".join(args[:2]), *args[2:]]
        name, listed, rest = super().resolve_command(ctx, args)
        if name is None or listed is None:
            return name, listed, rest
        command = imported(name, self._entry_of(name), type(self).before_command)
        type(self).before_command()
        return name, command, rest

    def _entry_of(self, name: str) -> Command | Group:
        return next(entries[name] for entries in self.entry.panels.values() if name in entries)


def group_of(entry: Group, before_command: Prepare, base: type[LazyGroup] = LazyGroup) -> type[TyperGroup]:
    """Return the class of the group that `entry` describes."""
    return type("Group", (base,), {"entry": entry, "before_command": staticmethod(before_command)})


def imported(name: str, entry: Command | Group, before_command: Prepare = lambda: None) -> Any:
    """Return the command of `entry`, its module imported; of a group, none of its commands is."""
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False, rich_markup_mode=None)
    epilog = "\n".join(f"companion {example}" for example in entry.examples)
    if isinstance(entry, Group):
        app.callback(
            cls=group_of(entry, before_command),
            help=entry.about,
            epilog=epilog,
            no_args_is_help=True,
            context_settings=dict(SETTINGS),
        )(_nothing)
    else:
        module, function = entry.place.split(":")
        command = getattr(_module(f"companion.cli.{module}"), function)
        app.command(name, cls=HelpCommand, epilog=epilog, context_settings={**SETTINGS, **entry.settings})(command)
    made = typer.main.get_command(app)
    made.name = name
    return made


def _module(name: str) -> ModuleType:
    """Import a module; the garbage collector, which would look through all that is new a dozen times, waits."""
    collects = gc.isenabled()
    gc.disable()
    try:
        return import_module(name)
    finally:
        if collects:
            gc.enable()


def _nothing() -> None:
    """Callback of a group that has no options of its own."""
