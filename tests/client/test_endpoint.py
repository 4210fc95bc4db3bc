"""Tests of the endpoint: options, a file, the environment, this computer, in this order."""

from pathlib import Path

import pytest

from companion.client.endpoint import BROKER, PASSWORD_FILE, VEHICLE, EndpointOptions, endpoint_of, url_of
from companion.core.interfaces import ConfigError


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (BROKER, VEHICLE, PASSWORD_FILE):
        monkeypatch.delenv(name, raising=False)


def test_without_a_word_it_is_this_computer() -> None:
    endpoint = endpoint_of(EndpointOptions())
    assert (url_of(endpoint), endpoint.topics.command) == ("mqtt://127.0.0.1:1883", "dauam/v1/vehicle/command")


def test_options_go_before_a_file_and_that_before_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(BROKER, "mqtts://ann@far")
    monkeypatch.setenv(VEHICLE, "lab/two")
    endpoint = endpoint_of(EndpointOptions())
    assert (url_of(endpoint), endpoint.topics.root) == ("mqtts://ann@far:8883", "lab/v1/two")
    file = tmp_path / "my.toml"
    file.write_text('[operator]\nhost = "near"\nvehicle = "three"\n[whatever]\n')
    endpoint = endpoint_of(EndpointOptions(vehicle="four", config=file))
    assert (url_of(endpoint), endpoint.topics.root) == ("mqtt://near:1883", "dauam/v1/four")


def test_a_password_comes_from_a_file_that_is_its_owners(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("secret\n")
    file.chmod(0o600)
    endpoint = endpoint_of(EndpointOptions(broker="mqtt://ann@near", password_file=str(file)))
    assert endpoint.password() == "secret"
    assert "secret" not in url_of(endpoint)
    file.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        endpoint_of(EndpointOptions(broker="mqtt://ann@near", password_file=str(file)))


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            EndpointOptions(broker="http://near"),
            "--broker 'http://near': scheme http is not supported: give mqtt://HOST",
        ),
        (EndpointOptions(broker="mqtt://near:port"), "--broker 'mqtt://near:port': Port could not be cast"),
        (EndpointOptions(broker="mqtt://near/topic"), "--broker 'mqtt://near/topic': not the address of a broker"),
        (EndpointOptions(broker="mqtt://ann:secret@near"), "--broker: a password in an address is visible to others"),
        (
            EndpointOptions(broker="near", ca_file="no.pem"),
            "the broker's options: ca_file = 'no.pem': there is no such file",
        ),
        (EndpointOptions(vehicle="a/b/c"), "the broker's options: prefix = 'a/b': must be 1 to 32 letters"),
        (EndpointOptions(vehicle="/c"), "--vehicle '/c': give VEHICLE, or PREFIX/VEHICLE"),
        (EndpointOptions(password_file="none"), "the broker's options: password_file = 'none': there is no such file"),
        (EndpointOptions(config=Path("config/mock.toml")), "config/mock.toml: has no table [operator]"),
    ],
)
def test_what_cannot_be_is_one_sentence_without_a_secret(given: EndpointOptions, sentence: str) -> None:
    with pytest.raises(ConfigError) as error:
        endpoint_of(given)
    assert str(error.value).startswith(sentence)
    assert "secret" not in str(error.value)
