"""A broker whose certificate is out of date, or for another name: what is wrong and what to do, at both ends."""

import asyncio
import logging
import re
import ssl
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.adapters.mqtt.link import BusLink
from companion.client.client import open_console
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError
from tests.adapters.mqtt.rig import CLOCK, SESSION, Vehicle, until

_CA_USAGE = ("-addext", "keyUsage=critical,keyCertSign,cRLSign")
"""Python 3.13 asks for it, and for the server's key identifiers (ssl.VERIFY_X509_STRICT)."""
_SERVER = """subjectAltName=DNS:localhost,IP:127.0.0.1
subjectKeyIdentifier=hash
authorityKeyIdentifier=keyid
"""
_CA_CONFIG = """[ca]
default_ca = one
[one]
database = index
serial = serial
new_certs_dir = .
certificate = ca.crt
private_key = ca.key
default_md = sha256
policy = any
unique_subject = no
[any]
commonName = supplied
"""
_RENEW = r"renew the broker's certificate \(config/mosquitto/make-certificates.sh\), or set this computer's clock"
_YEARS = {"expired": (2020, 2021), "future": (2038, 2039), "good": (2020, 2049)}


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with certificates for localhost and 127.0.0.1."""
    folder = tmp_path_factory.mktemp("authority")

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    key = ["-newkey", "rsa:2048", "-nodes", "-keyout"]
    openssl("req", "-x509", *key, "ca.key", "-out", "ca.crt", "-days", "3650", "-subj", "/CN=lab", *_CA_USAGE)
    (folder / "ca.cnf").write_text(_CA_CONFIG)
    (folder / "names").write_text(_SERVER)
    openssl("req", *key, "server.key", "-out", "server.csr", "-subj", "/CN=localhost")
    for name, (first, last) in _YEARS.items():
        (folder / "index").write_text("")
        (folder / "serial").write_text("01\n")
        dates = ["-startdate", f"{first}0101000000Z", "-enddate", f"{last}0101000000Z"]
        openssl(
            "ca", "-batch", "-config", "ca.cnf", "-in", "server.csr", "-out", f"{name}.crt", *dates, "-extfile", "names"
        )
    return folder


@asynccontextmanager
async def serving(authority: Path, name: str) -> AsyncIterator[int]:
    """Yield the port of a TLS server with this certificate; its client does not reach MQTT."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(authority / f"{name}.crt", authority / "server.key")

    async def accept(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()

    asyncio.get_running_loop().set_exception_handler(lambda *_: None)  # a client that goes is part of the test
    async with await asyncio.start_server(accept, "0.0.0.0", 0, ssl=context) as server:
        yield server.sockets[0].getsockname()[1]


@pytest.mark.parametrize(
    ("name", "host", "said"),
    [
        ("expired", "127.0.0.1", f"certificate has expired: {_RENEW}"),
        ("future", "127.0.0.1", f"certificate is not yet valid: {_RENEW}"),
        ("good", "127.0.0.2", "certificate is not valid for '127.0.0.2': use a name that the certificate is for"),
    ],
)
async def test_both_ends_say_what_is_wrong_and_what_to_do(
    authority: Path, name: str, host: str, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    async with serving(authority, name) as port:
        place = OperatorConfig(host=host, port=port, tls=True, ca_file=str(authority / "ca.crt"))
        with pytest.raises(ConfigError, match=said):
            async with open_console(place):
                pass
        async with BusLink(place, CLOCK, SESSION).listening(Vehicle().on_command):
            await until(lambda: "is not there: certificate verify failed" in caplog.text)
    assert re.search(said, caplog.text)


async def test_a_ca_that_did_not_sign_it_is_named(authority: Path) -> None:
    async with serving(authority, "good") as port:
        with pytest.raises(ConfigError, match=r"is the CA file \(--ca-file, .* the one that signed its certificate\?$"):
            async with open_console(OperatorConfig(port=port, tls=True)):
                pass
