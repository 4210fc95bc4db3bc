"""Who may command from the page: limits on logins, sessions, the demo's token."""

from companion.page.access import (
    MOST_TRIES,
    MOST_TRIES_IN_ALL,
    SESSION_S,
    WINDOW_S,
    OneTimeToken,
    Sessions,
    Tries,
    is_loopback,
)


def test_an_address_may_try_five_times_a_minute() -> None:
    tries = Tries()
    assert [tries.wait_s("a", float(second)) for second in range(MOST_TRIES)] == [0.0] * MOST_TRIES
    assert tries.wait_s("a", 10.0) == WINDOW_S - 10.0, "until the first one is a minute old"
    assert tries.wait_s("b", 10.0) == 0.0, "another address"
    assert tries.wait_s("a", WINDOW_S) == 0.0


def test_a_refused_try_does_not_count() -> None:
    tries = Tries()
    for now_s in range(1000):
        tries.wait_s("a", 0.01 * now_s)
    assert tries.wait_s("a", WINDOW_S) == 0.0


def test_all_addresses_together_may_try_thirty_times_a_minute() -> None:
    tries = Tries()
    waits = [tries.wait_s(f"10.0.0.{number}", 0.0) for number in range(40)]
    assert sum(wait == 0.0 for wait in waits) == MOST_TRIES_IN_ALL
    assert tries.wait_s("10.0.1.1", WINDOW_S - 0.1) > 0.0
    assert tries.wait_s("10.0.1.1", WINDOW_S) == 0.0


def test_a_million_addresses_take_no_memory() -> None:
    tries = Tries()
    for number in range(30_000):
        tries.wait_s(str(number), 0.0)
    assert len(tries._of) == MOST_TRIES_IN_ALL


def test_a_session_lasts_until_its_end() -> None:
    sessions = Sessions()
    cookie = sessions.begin(0.0)
    assert sessions.lasts(cookie, SESSION_S - 1.0)
    assert not sessions.lasts(cookie, SESSION_S)
    assert not sessions.lasts(cookie[:-1], 1.0)
    assert not sessions.lasts("", 1.0)
    sessions.end(cookie)
    assert not sessions.lasts(cookie, 1.0)


def test_of_very_many_sessions_the_oldest_ends() -> None:
    sessions = Sessions()
    cookies = [sessions.begin(0.0) for _ in range(150)]
    assert [sessions.lasts(cookie, 1.0) for cookie in cookies] == [False] * 50 + [True] * 100


def test_a_token_works_once_and_from_this_computer() -> None:
    token = OneTimeToken("secret")
    assert not token.take("secret", "192.168.0.7")
    assert not token.take("guess", "127.0.0.1")
    assert token.take("secret", "127.0.0.1")
    assert not token.take("secret", "127.0.0.1")
    assert not OneTimeToken("").take("", "127.0.0.1"), "without a token there is none"


def test_addresses_of_this_computer() -> None:
    assert [is_loopback(one) for one in ("127.0.0.1", "::1", "192.168.0.7", "", "localhost", "fe80::1%eth0")] == [
        True, True, False, False, False, False,
    ]  # fmt: skip
