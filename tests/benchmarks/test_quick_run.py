"""The whole bench once, over real sockets and processes; its numbers are not judged here."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.realtime
def test_a_quick_latency_run_measures_service_and_relay(tmp_path: Path) -> None:
    report = tmp_path / "bench.json"
    command = [sys.executable, "-m", "benchmarks", "--quick", "--only", "latency", "--json", str(report)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(report.read_text())
    (latency,) = found["latencies"]
    assert 0.0 < latency["relay_us"]["median"] < latency["service_us"]["median"]
    assert latency["service_us"]["count"] > 100
    assert {target["met"] for target in found["targets"]} <= {True, False}
    assert found["machine"]["cores"] >= 1
