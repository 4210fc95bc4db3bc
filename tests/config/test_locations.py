"""Configuration that a command reads when it is given none, and that it says so."""

from pathlib import Path

import pytest

from companion.cli.options import vehicle_settings
from companion.cli.records.records import records
from companion.config import locations
from companion.config.locations import default_config_path, project_root, vehicle_config_path
from companion.core.errors import ConfigError

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "companion.toml"
    path.write_text(f'[vehicle]\nmass_kg = 5.5\n[records]\nfolder = "{tmp_path}/flights"\n')
    monkeypatch.setattr(locations, "INSTALLED", path)
    return path


def test_on_an_installed_vehicle_it_is_its_own_and_the_first_line_says_so(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = vehicle_settings(None)
    assert settings.vehicle.mass_kg == 5.5
    assert capsys.readouterr().err == f"companion: configuration {installed}\n"


def test_what_was_given_goes_before(installed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = tmp_path / "mine.toml"
    given.write_text("[vehicle]\nmass_kg = 3.0\n")
    assert vehicle_settings(given).vehicle.mass_kg == 3.0
    assert capsys.readouterr().err == ""


def test_without_an_installation_it_is_the_checkouts_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(locations, "INSTALLED", tmp_path / "none" / "companion.toml")
    assert vehicle_config_path() == CHECKOUT / "config" / "lab.toml"
    assert vehicle_settings(None).px4.url == "serial:///dev/ttyUSB0:921600"
    assert capsys.readouterr().err == f"companion: configuration {CHECKOUT / 'config' / 'lab.toml'}\n"


def test_one_that_cannot_be_looked_at_is_not_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that others may not enter: the example's fence is not this vehicle's."""

    class Locked(type(tmp_path)):  # type: ignore[misc]
        def stat(self, *, follow_symlinks: bool = True) -> None:
            del follow_symlinks
            raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(locations, "INSTALLED", Locked(tmp_path / "companion.toml"))
    assert vehicle_config_path() == locations.INSTALLED


def test_records_are_listed_from_the_installed_vehicles_folder(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = installed.parent / "flights"
    with pytest.raises(ConfigError, match=str(folder)):
        records()
    folder.mkdir()
    records()
    said = capsys.readouterr()
    assert f"no records in {folder}" in said.out
    assert said.err.splitlines()[0] == f"companion: configuration {installed}"


def test_a_folder_that_happens_to_have_a_config_is_no_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "config").mkdir()
    monkeypatch.chdir(tmp_path)
    assert project_root() == CHECKOUT
    (tmp_path / "config" / "controllers").mkdir()
    assert default_config_path("demo.toml") == tmp_path / "config" / "demo.toml"
