"""Locations of configurations: of the installed vehicle, or of the checkout. Imports nothing that takes time."""

from pathlib import Path

INSTALLED = Path("/etc/dauam/companion.toml")
"""The vehicle's own, once `make install` has written it (docs/install.md)."""


def project_root() -> Path:
    """Return the folder that holds config/: where we stand, or the checkout this code runs from."""
    here = Path.cwd()
    return here if (here / "config" / "controllers").is_dir() else Path(__file__).resolve().parents[2]


def default_config_path(name: str) -> Path:
    """Return a file of the project's own config folder."""
    return project_root() / "config" / name


def names_in(folder: str) -> list[str]:
    """Return the names, without .toml, of the files in a folder of config/, sorted."""
    return sorted(path.stem for path in default_config_path(folder).glob("*.toml"))


def named_file(folder: str, name: str) -> Path | None:
    """Return config/FOLDER/NAME.toml, else the file at the path `name`; None when there is neither."""
    paths = (default_config_path(folder) / f"{name}.toml", Path(name))
    return next((path for path in paths if path.is_file()), None)


def is_installed() -> bool:
    """Return whether this computer has a vehicle's configuration, be it readable for us or not."""
    try:
        INSTALLED.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def vehicle_config_path() -> Path:
    """Return the configuration of commands for a vehicle: the installed one, else the checkout's config/lab.toml."""
    return INSTALLED if is_installed() else default_config_path("lab.toml")
