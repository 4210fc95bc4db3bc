"""The check that no task outlives its test can itself fail."""

import pytest

pytest_plugins = ["pytester"]


def test_a_task_left_running_fails_its_test(pytester: pytest.Pytester, request: pytest.FixtureRequest) -> None:
    conftest = request.config.rootpath / "tests" / "conftest.py"
    pytester.makeconftest(conftest.read_text())
    pytester.makepyfile(
        """
        import asyncio
        _kept = []
        async def test_leaves_a_task():
            _kept.append(asyncio.create_task(asyncio.sleep(60), name="forgotten"))
        async def test_cleans_up():
            await asyncio.create_task(asyncio.sleep(0))
        """
    )
    options = ["-o", "asyncio_mode=auto", "-o", "asyncio_default_fixture_loop_scope=function"]
    options += ["-o", f"pythonpath={request.config.rootpath}"]
    result = pytester.runpytest_subprocess(*options)
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines(["*tasks outlived the test: forgotten*"])
