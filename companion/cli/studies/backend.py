"""Options of the studies: where they fly, and what of an earlier run they reuse."""

import os
from typing import Annotated
from urllib.parse import urlsplit

import typer

from companion.core.interfaces import ConfigError
from companion.simulation.workers import Backend

_DASK_PORT = 8786
"""The usual port of a dask scheduler."""

Jobs = Annotated[int | None, typer.Option(min=1, max=256, help="Number of processes.  [default: one per CPU]")]
OnCluster = Annotated[
    str | None,
    typer.Option(
        "--on",
        metavar="dask://HOST:8786",
        help="Fly on the workers of this dask scheduler instead of processes of this computer.",
    ),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Fly everything again instead of reusing finished parts.")]


def local_jobs(jobs: int | None) -> int:
    """Return the number of processes of this computer."""
    return jobs or len(os.sched_getaffinity(0))


def backend_of(on: str | None, jobs: int | None) -> Backend:
    """Return the computers that `--on` and `--jobs` mean; ConfigError for an address that is none, or for both."""
    if on is None:
        return Backend(local_jobs(jobs))
    if jobs is not None:
        raise ConfigError(f"--on {on}: the cluster has its own number of processes: leave --jobs {jobs} out")
    return Backend(scheduler=_address(on))


def _address(on: str) -> str:
    try:
        parts = urlsplit(on)
        port = parts.port or _DASK_PORT
    except ValueError:
        raise _not_dask(on) from None
    if parts.scheme != "dask" or not parts.hostname or parts.netloc.count("@") or parts.path.strip("/"):
        raise _not_dask(on)
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"{host}:{port}"


def _not_dask(on: str) -> ConfigError:
    return ConfigError(f"--on {on}: must be dask://HOST:PORT, the address of a dask scheduler")
