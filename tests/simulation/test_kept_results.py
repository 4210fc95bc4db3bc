"""Results of finished jobs as files: the same content is found again, in any process."""

import hashlib
import operator
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.config.locations import project_root
from companion.core.interfaces import CompanionError
from companion.simulation.build import this_build
from companion.simulation.kept_results import KeptResults, content
from companion.simulation.scene import load_scene


def test_a_result_is_found_for_the_same_task_alone(tmp_path: Path) -> None:
    kept = KeptResults(tmp_path)
    kept.write(operator.neg, 3.0, -3.0)
    assert kept.found(operator.neg, [2.0, 3.0]) == {1: -3.0}
    assert kept.read(operator.pos, 3.0) is None
    assert KeptResults(tmp_path, fresh=True).read(operator.neg, 3.0) is None


def test_results_without_the_compiled_law_are_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch's last digits differ between numpy and the compiled law."""
    monkeypatch.setattr("companion.simulation.build.shutil.which", lambda _: "cc")
    builds = []
    for loaded in (None, object()):
        monkeypatch.setattr("companion.simulation.build.library", lambda loaded=loaded: loaded)
        builds.append(this_build.__wrapped__())
    assert builds[0].difference(builds[1]) == "flies with the compiled law, not with Python alone"
    paths = set()
    for build in builds:
        monkeypatch.setattr("companion.simulation.kept_results.this_build", lambda build=build: build)
        paths.add(KeptResults(tmp_path).path(operator.neg, 3.0))
    assert len(paths) == 2


@pytest.mark.parametrize("damage", [b"", b"x" * 50])
def test_a_damaged_file_is_as_none(tmp_path: Path, damage: bytes) -> None:
    kept = KeptResults(tmp_path)
    kept.write(operator.neg, 3.0, -3.0)
    kept.path(operator.neg, 3.0).write_bytes(damage)
    assert kept.read(operator.neg, 3.0) is None


def test_a_folder_that_cannot_be_written_to_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CompanionError, match=r"cannot write to .*file"):
        KeptResults(tmp_path / "file").write(operator.neg, 3.0, -3.0)


_PRINT = """
import hashlib
from companion.simulation.kept_results import content
from companion.simulation.scene import load_scene
print(hashlib.sha256(content(load_scene("ellipse"))).hexdigest())
"""


def _output(script: str, environment: dict[str, str]) -> str:
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, cwd=project_root(), env=environment, check=True, capture_output=True, text=True)
    return ran.stdout.strip()


@pytest.mark.slow
def test_content_is_the_same_in_every_process_and_whatever_is_cached() -> None:
    scene = load_scene("ellipse")
    before = content(scene)
    assert _output(_PRINT, {"PYTHONHASHSEED": "1"}) == hashlib.sha256(before).hexdigest()
    assert scene.vehicle().arms is not None
    assert content(scene) == before
    assert content(scene.with_bandwidth(7.0)) != before


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of this processor's instructions")
def test_a_processor_that_computes_in_another_way_has_another_build() -> None:
    """Numpy rounds some functions in another way without the instructions that it chooses on this processor."""
    script = "from companion.simulation.build import this_build; print(this_build().arithmetic)"
    found = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    assert _output(script, {}) == this_build().arithmetic
    assert _output(script, {"NPY_DISABLE_CPU_FEATURES": " ".join(found)}) != this_build().arithmetic
