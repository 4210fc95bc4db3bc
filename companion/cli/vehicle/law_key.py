"""`companion law-key`: a new key for the link between a law on the ground and its vehicle."""

import os
import secrets
from pathlib import Path
from typing import Annotated

import typer

from companion.core.interfaces import ConfigError

_BYTES = 32


def law_key(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write; never overwritten.")],
) -> None:
    """Write a new random key into FILE, readable for you alone; both computers need the same one.

    Name it in law.link.key_file on the vehicle and on the ground. Exit code 2 if the file exists or cannot be written.
    """
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise ConfigError(f"{file} exists: remove it first if its key is not in use any more") from None
    with os.fdopen(descriptor, "w", encoding="ascii") as out:
        out.write(secrets.token_urlsafe(_BYTES) + "\n")
    typer.echo(f"wrote {file}: copy it to the other computer, and name both in law.link.key_file", err=True)
