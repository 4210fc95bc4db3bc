"""Values that the [operator] table of a configuration accepts."""

from pathlib import Path
from typing import Any

import pytest

from companion.config.operator_config import OperatorConfig
from companion.config.toml_files import validate
from companion.core.interfaces import ConfigError
from companion.protocol.topics import Topics


def read(**table: Any) -> OperatorConfig:
    return validate(OperatorConfig, table, Path("mine.toml"), "operator")


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    path = tmp_path / "password"
    path.write_text("sesame\n")
    path.chmod(0o600)
    return path


def test_topics_are_the_vehicles() -> None:
    assert read(prefix="lab-2", vehicle="dauam_1").topics == Topics("lab-2", "dauam_1")


@pytest.mark.parametrize("name", ["", "a/b", "+", "#", "$SYS", "n\u00e4h", "x" * 33, "a b"])
def test_a_name_that_is_no_part_of_a_topic_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=r"operator\.vehicle = .*: must be 1 to 32 letters"):
        read(vehicle=name)


def test_a_password_that_a_windows_editor_saved_is_the_same(secret: Path) -> None:
    secret.write_bytes(b"\xef\xbb\xbfsesame\r\n")
    assert read(user="dauam", password_file=str(secret)).password() == "sesame"


def test_a_password_is_read_without_its_line_end(secret: Path) -> None:
    assert read(user="dauam", password_file=str(secret)).password() == "sesame"
    assert read(user="dauam").password() is None


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"password_file": "{secret}"}, "password_file is the password of a user: give user as well"),
        ({"ca_file": "{secret}"}, "ca_file says whose certificates count: give tls = true as well"),
        ({"user": "x", "password_file": "/no/such"}, "there is no such file"),
        ({"user": "x", "password_file": "{folder}"}, "is no file"),
        ({"tls": True, "ca_file": "/no/such"}, "there is no such file"),
        ({"user": ""}, "must not be empty"),
        ({"embedded": True, "user": "x"}, "takes neither user nor tls"),
        ({"embedded": True, "tls": True}, "takes neither user nor tls"),
        ({"embedded": True, "host": "192.168.1.2"}, "host must be 127.0.0.1, not '192.168.1.2'"),
        ({"embedded": 1}, "must be true or false"),
        ({"password": "sesame"}, "operator.password: unknown key, did you mean 'password_file'"),
    ],
)
def test_a_mistake_is_one_sentence(table: dict[str, Any], sentence: str, secret: Path) -> None:
    filled = {
        key: value.format(secret=secret, folder=secret.parent) if isinstance(value, str) else value
        for key, value in table.items()
    }
    with pytest.raises(ConfigError) as error:
        read(**filled)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("mode", [0o644, 0o604, 0o602, 0o777])
def test_a_password_that_others_may_read_or_write_is_refused(mode: int, secret: Path) -> None:
    secret.chmod(mode)
    with pytest.raises(ConfigError, match=rf"every user of this computer may read or write it: chmod 600 {secret}"):
        read(user="dauam", password_file=str(secret))


@pytest.mark.parametrize("said", [b"", b"\n", b"two\nlines", b"\xff\xfe", b"x" * 2000])
def test_what_is_no_password_is_refused(said: bytes, secret: Path) -> None:
    secret.write_bytes(said)
    with pytest.raises(ConfigError, match=r"^operator\.password_file = "):
        read(user="dauam", password_file=str(secret)).password()
