"""Who may command from the page: limits on logins, sessions, the demo's token."""

from companion.page.access import (
    MOST_TRIES,
    MOST_TRIES_IN_ALL,
    SESSION_S,
    WINDOW_S,
    KnownBrowsers,
    OneTimeToken,
    Sessions,
    Tries,
    is_loopback,
    network_of,
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


def test_six_that_guess_without_end_leave_room_for_a_new_address() -> None:
    tries = Tries()
    for now_s in range(600):
        counted = [tries.wait_s(f"10.0.0.{number}", float(now_s)) for number in range(6) for _ in range(MOST_TRIES)]
        assert sum(wait_s == 0.0 for wait_s in counted) <= 6 * MOST_TRIES
        if now_s % 60 == 59:
            assert tries.wait_s(f"192.168.0.{now_s // 60}", float(now_s)) == 0.0


def test_a_refused_address_is_told_when_its_next_try_counts() -> None:
    tries = Tries()
    for second in range(20):
        assert tries.wait_s(f"10.0.0.{second // 5}", float(second)) == 0.0
    assert tries.wait_s("10.0.1.1", 20.0) == 0.0
    wait_s = tries.wait_s("10.0.1.1", 21.0)
    assert (wait_s, tries.wait_s("10.0.1.1", 21.0 + wait_s)) == (WINDOW_S + 1.0 - 21.0, 0.0)


def test_known_browsers_do_not_count_among_all() -> None:
    tries = Tries()
    for number in range(100):
        assert tries.wait_s(f"mark {number}", 0.0, known=True) == 0.0
    assert tries.wait_s("10.0.0.1", 0.0) == 0.0
    for _ in range(MOST_TRIES - 1):
        tries.wait_s("mark 0", 1.0, known=True)
    assert tries.wait_s("mark 0", 2.0, known=True) == WINDOW_S - 2.0, "each by itself"


def test_a_computer_with_many_ipv6_addresses_is_one() -> None:
    assert network_of("2001:db8::1") == network_of("2001:db8::ffff:1") != network_of("2001:db8:0:1::1")
    assert network_of("fe80::1%eth0") == network_of("fe80::2%eth1")
    assert network_of("10.0.0.1") == network_of("::ffff:10.0.0.1") != network_of("10.0.0.2")
    assert network_of("") == ""


def test_only_marks_of_the_same_key_are_known() -> None:
    browsers = KnownBrowsers(b"key")
    mark = browsers.mark()
    assert browsers.knows(mark)
    assert mark != browsers.mark()
    assert KnownBrowsers(b"key").knows(mark), "also after the server has begun again"
    for wrong in ("", ".", mark[:-1], f"x{mark}", mark.partition(".")[0], f"{mark}\xe9"):
        assert not browsers.knows(wrong)
    assert not KnownBrowsers(b"other").knows(mark)


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
