"""`python -m mock_autopilot.impairment` as its user meets it."""

import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from mock_autopilot.impairment.__main__ import main
from mock_autopilot.impairment.ports import address
from tests.warm import Piped


@contextmanager
def started(*arguments: str) -> Iterator[tuple[Piped, int]]:
    """Return the process and the port that it listens on."""
    process = Piped("mock_autopilot.impairment", "--listen", "0", *arguments)
    try:
        ready = process.stdout.readline()
        assert ready.startswith("impairment ready: "), ready
        yield process, int(ready.split()[3].rpartition(":")[2])
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=10.0)


def said_to(process: Piped, line: str) -> str:
    process.stdin.write(f"{line}\n")
    process.stdin.flush()
    return process.stdout.readline().strip()


def test_it_passes_datagrams_obeys_new_sentences_and_counts_in_the_end() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(5.0)
        to = f"127.0.0.1:{server.getsockname()[1]}"
        with started("--to", to, "--udp", "clean") as (process, port):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
                client.settimeout(5.0)
                client.connect(("127.0.0.1", port))
                client.send(b"hello")
                payload, relay = server.recvfrom(100)
                server.sendto(payload.upper(), relay)
                assert client.recv(100) == b"HELLO"
                assert said_to(process, "up off; down delay 5 ms") == "impairment now: up loss 100%; down delay 5 ms"
                client.send(b"lost")
            while "1 lost" not in (counted := said_to(process, "")):
                process.stdout.readline()
            assert counted == "udp up (to the server): 2 sent (9 bytes), 1 lost (50.0%), 1 arrived"
            assert process.stdout.readline() == "udp down (to the client): 1 sent (5 bytes), 0 lost, 1 arrived\n"
            process.send_signal(signal.SIGINT)
            assert process.wait(10.0) == 0
            assert process.stdout.read().count("\n") == 2, "the counts at the end"
            assert process.stderr.read() == ""


def test_a_mistake_on_standard_input_changes_nothing() -> None:
    with started("--to", "127.0.0.1:9", "--tcp", "loss 5%") as (process, _):
        process.stdin.write("los 10%\n")
        process.stdin.flush()
        assert process.stderr.readline().startswith('impairment: "los" is no impairment; possible: ')
        assert said_to(process, "delay 1 ms") == "impairment now: delay 1 ms"


def test_a_fault_lasts_as_long_as_it_says_on_top_of_the_links_own() -> None:
    with started("--to", "127.0.0.1:9", "--udp", "delay 1 ms") as (process, _):
        assert said_to(process, "fault network off for 0.1 s") == "impairment now: delay 1 ms, network off for 0.1 s"
        assert process.stdout.readline() == "impairment now: delay 1 ms\n"
        for wrong, said in (("mocap off", "only faults of the network"), ("network of", 'network cannot be "of"')):
            process.stdin.write(f"fault {wrong}\n")
            process.stdin.flush()
            assert said in process.stderr.readline()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--to", "9001"), "give --udp or --tcp a sentence"),
        (("--to", "9001", "--udp", "loss 10"), 'loss is in %: "loss 10%"'),
        (("--to", "here:there", "--udp", "clean"), '"here:there" is no address'),
        (("--to", "70000", "--udp", "clean"), '"70000" is no address'),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--listen", "0", *arguments]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_help_has_every_kind_of_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert '"loss 30% burst 100 ms delay 5 ms"' in capsys.readouterr().out


def test_a_taken_port_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert main(["--listen", str(port), "--to", "9", "--udp", "clean"]) == 2
    assert f"cannot listen on UDP 127.0.0.1:{port}" in capsys.readouterr().err


def test_addresses_of_this_machine_of_others_and_of_ipv6() -> None:
    assert address("9001") == ("127.0.0.1", 9001)
    assert address("vehicle:9001") == ("vehicle", 9001)
    assert address("[::1]:9001") == ("::1", 9001)
