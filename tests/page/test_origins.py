"""Names and origins under which the page may be asked for."""

import pytest

from companion.page.origins import is_own_host, is_same_origin, own_names

NAMES = frozenset({"localhost", "room-pc", "room-pc.local"})


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1", "127.0.0.1:8080", "192.168.0.10:8080", "[::1]:8080", "[fe80::1]", "localhost:8080", "Room-PC",
     "room-pc.local:443", "localhost."],
)  # fmt: skip
def test_addresses_and_own_names_are_served(host: str) -> None:
    assert is_own_host(host, NAMES)


@pytest.mark.parametrize(
    "host",
    ["", "evil.example", "evil.example:8080", "room-pc.evil.example", "127.0.0.1.evil.example",
     "localhost@evil.example", "localhost:8080:1", "localhost:", "[localhost]", "[127.0.0.1", "::1", "localhost/",
     "localhost evil", "localhost\x00", "0x7f.1", "127.0.0.1, evil.example", "\u00b5.local"],
)  # fmt: skip
def test_every_other_name_is_foreign(host: str) -> None:
    assert not is_own_host(host, NAMES)


def test_own_names_have_the_address_to_listen_on() -> None:
    assert {"localhost", "lab.example"} <= own_names("LAB.example")
    assert all(name == name.lower() for name in own_names("x"))


@pytest.mark.parametrize(
    ("origin", "same"),
    [
        ("http://127.0.0.1:8080", True),
        ("HTTP://127.0.0.1:8080", True),
        (None, False),
        ("", False),
        ("null", False),
        ("https://127.0.0.1:8080", False),
        ("http://127.0.0.1", False),
        ("http://127.0.0.1:8081", False),
        ("http://127.0.0.1:8080.evil.example", False),
        ("http://127.0.0.1:8080/", False),
        ("http://evil.example", False),
    ],
)
def test_an_origin_is_scheme_name_and_port(origin: str | None, same: bool) -> None:
    assert is_same_origin(origin, "http", "127.0.0.1:8080") is same
