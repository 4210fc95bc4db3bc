"""One broker for all tests of this folder."""

from collections.abc import Iterator

import pytest

from tests.broker import BrokerProcess, broker


@pytest.fixture(scope="session")
def shared_broker() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process
