"""`companion law`, `companion law-key`, and `companion serve` for a law on the ground: a user's mistakes."""

import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.adapters.system.instance_lock import law_lock
from companion.config.companion_config import load_config
from companion.core.errors import ConfigError
from tests.cli.typed import Type, typing

GOOD_KEY = "0123456789abcdef0123456789abcdef"


@pytest.fixture
def law(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return typing("law", monkeypatch, capsys)


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return typing("serve", monkeypatch, capsys)


@pytest.fixture
def law_key(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return typing("law-key", monkeypatch, capsys)


@pytest.fixture
def config(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a configuration with this key, and returns its path."""

    def write(key: str | None = GOOD_KEY, mode: int = 0o600, runs_on: str = "ground", link: str = "") -> Path:
        file, text = tmp_path / "law.key", f'[law]\nruns_on = "{runs_on}"\n[law.link]\n{link}\n'
        if key is not None:
            file.write_text(key + "\n")
            file.chmod(mode)
            text += f'key_file = "{file}"\n'
        path = tmp_path / "ground.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("command", ["law", "serve"])
@pytest.mark.parametrize(
    ("key", "mode", "says"),
    [
        (None, 0o600, "link.key_file is missing; `companion law-key FILE` makes one"),
        ("short", 0o600, "5 characters, at least 16 are needed: `companion law-key FILE` makes one"),
        ("", 0o600, "must hold one line, the key"),
        (f"{GOOD_KEY}\n{GOOD_KEY}", 0o600, "must hold one line, the key"),
        (GOOD_KEY, 0o644, "every user of this computer may read or write it: chmod 600"),
    ],
)
def test_a_key_that_cannot_be_used_is_one_sentence(
    command: str, key: str | None, mode: int, says: str, config: Callable[..., Path], request: pytest.FixtureRequest
) -> None:
    typed = request.getfixturevalue(command)("--config", config(key, mode))
    assert typed.code == 2
    assert says in typed.err
    assert typed.err.count("\n") == 1, "one sentence"


@pytest.mark.parametrize("command", ["law", "serve"])
def test_a_key_file_that_is_not_there_is_named(
    command: str, config: Callable[..., Path], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    missing = tmp_path / "none.key"
    typed = request.getfixturevalue(command)("--config", config(None, link=f'key_file = "{missing}"'))
    assert typed.code == 2
    assert str(missing) in typed.err
    assert typed.err.count("\n") == 1


def test_a_law_for_a_vehicle_that_runs_its_own_is_refused(law: Type, config: Callable[..., Path]) -> None:
    typed = law("--config", config(runs_on="onboard"))
    assert typed.code == 2
    assert 'law.runs_on = "onboard": the vehicle\'s service runs the law' in typed.err
    assert typed.err.count("\n") == 1


@pytest.mark.parametrize("option", [("--controller", "pid"), ("--allow-unstable",)])
def test_a_service_whose_law_is_elsewhere_takes_no_law(
    option: tuple[str, ...], serve: Type, config: Callable[..., Path]
) -> None:
    typed = serve("--config", config(), *option)
    assert typed.code == 2
    assert typed.err == (
        f'companion: {option[0]}: law.runs_on = "ground": give it to `companion law`, which runs the law\n'
    )


def test_an_unknown_law_is_refused_with_the_names_there_are(law: Type, config: Callable[..., Path]) -> None:
    typed = law("--config", config(), "--controller", "etn")
    assert typed.code == 2
    assert "etnn" in typed.err
    assert typed.err.count("\n") == 1


def test_a_second_law_for_one_vehicle_on_one_computer_is_refused(law: Type, config: Callable[..., Path]) -> None:
    path = config(link="port = 14699")
    with law_lock("127.0.0.1", 14699):
        typed = law("--config", path, "--controller", "pid")
    assert typed.code == 2
    assert "another `companion law` (process" in typed.err
    assert "for the vehicle at 127.0.0.1:14699: stop it first" in typed.err
    assert typed.err.count("\n") == 1


def test_a_new_key_is_for_its_owner_alone_and_can_be_used(
    law_key: Type, config: Callable[..., Path], tmp_path: Path
) -> None:
    file = tmp_path / "new.key"
    assert law_key(file).code == 0
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    link = load_config(config(None, link=f'key_file = "{file}"')).law.link
    assert len(link.secret()) >= 32
    other = tmp_path / "other.key"
    law_key(other)
    assert other.read_text() != file.read_text()


def test_a_key_is_never_overwritten(law_key: Type, tmp_path: Path) -> None:
    file = tmp_path / "law.key"
    file.write_text(GOOD_KEY)
    typed = law_key(file)
    assert typed.code == 2
    assert typed.err == f"companion: {file} exists: remove it first if its key is not in use any more\n"
    assert file.read_text() == GOOD_KEY


def test_a_key_in_a_folder_that_is_not_there_is_one_sentence(law_key: Type, tmp_path: Path) -> None:
    typed = law_key(tmp_path / "none" / "law.key")
    assert typed.code == 2
    assert typed.err == f"companion: {tmp_path / 'none' / 'law.key'}: No such file or directory\n"


@pytest.mark.parametrize(
    ("link", "says"),
    [
        ("port = 0", "law.link.port = 0: must be above 0"),
        ("beat_s = 0.2", "law.link.beat_s = 0.2: must be at most 0.05"),
        ('hosst = "a"', "law.link.hosst: unknown key, did you mean 'host'?"),
    ],
)
def test_a_wrong_value_of_the_link_is_named(link: str, says: str, config: Callable[..., Path]) -> None:
    with pytest.raises(ConfigError, match=says.replace("?", r"\?")):
        load_config(config(link=link))
