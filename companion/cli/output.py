"""Where results go, checked before the work that makes them."""

from pathlib import Path

from companion.ports import ConfigError


def check_output(out: Path | None, summary: Path | None) -> None:
    """Make the folders of `--out` and `--summary`; ConfigError when one cannot be written to."""
    if summary is not None and summary.is_dir():
        raise ConfigError(f"--summary {summary} is a folder: give the name of a file")
    for folder in (*([out] if out else []), *([summary.parent] if summary else [])):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot write to {folder}: {error.strerror}") from error
