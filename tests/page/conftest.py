"""A browser and fake servers, once for each file of tests.

Playwright's simple interface keeps an event loop running in its thread, and pytest-asyncio's loops run in the main one:
so the browser has a thread, and tests that use it run there.
"""

import inspect
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from playwright.sync_api import Browser

from tests.page.browser import chromium
from tests.page.fake_server import FakeServer, fake_server

_THREAD = ThreadPoolExecutor(1, "browser")


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that has a browser in the browser's thread."""
    if "browser" not in pyfuncitem.funcargs:
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in inspect.signature(pyfuncitem.obj).parameters}
    _THREAD.submit(pyfuncitem.obj, **arguments).result()
    return True


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with ExitStack() as stack:
        yield _THREAD.submit(stack.enter_context, chromium()).result()
        _THREAD.submit(stack.close).result()


@pytest.fixture(scope="module")
def _one() -> Iterator[FakeServer]:
    with fake_server("vehicle") as fake:
        yield fake


@pytest.fixture(scope="module")
def _three() -> Iterator[FakeServer]:
    with fake_server("dauam-1", "dauam-2", "dauam-3") as fake:
        yield fake


@pytest.fixture
def one(_one: FakeServer) -> FakeServer:
    _one.reset()
    return _one


@pytest.fixture
def three(_three: FakeServer) -> FakeServer:
    _three.reset()
    return _three
