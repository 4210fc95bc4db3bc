"""The search space of a peer's law: from its file, as a batch, and back into a file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.config.controller_config import PEERS, load_controller, read_controller
from companion.control.controller import VehicleModel
from companion.control.peers.geometric_pid import GeometricPid
from companion.control.peers.outer_loop import PeerLaw
from companion.core.interfaces import ConfigError
from companion.studies.tuning.gain_space import rounded, shares_of, values_of
from companion.studies.tuning.peer_space import PeerSpace
from companion.studies.tuning.tuning import Trial, evaluate
from companion.trajectories.reference import Ellipse, LapTiming
from tests.control.test_whole_laws import at, inputs
from tests.simulation.scenes import CENTRE, PUSHED, scene

VEHICLE = VehicleModel()


@pytest.mark.parametrize("name", PEERS)
def test_a_batch_of_gains_flies_each_vehicle_under_its_own(name: str, tmp_path: Path) -> None:
    """Two points: what the batch commands is what files with these gains command."""
    space = PeerSpace(read_controller(name))
    points = np.stack((shares_of(space.start, space.knobs), np.linspace(0.35, 0.65, len(space.knobs))))
    each = [rounded(point, space.knobs) for point in points]
    law = space.law_of({key: np.array([one[key] for one in each]) for key in each[0]}, VEHICLE, 0.01)
    seen = inputs((2,), 8)
    alone: list[PeerLaw[Any]] = []
    for row, values in enumerate(each):
        path = tmp_path / f"{row}.toml"
        path.write_text(space.toml(values, "companion tune"), encoding="utf-8")
        loaded = load_controller(str(path), VEHICLE, 0.01).law
        assert isinstance(loaded, PeerLaw)
        assert np.broadcast_to(space.previews_s(law), 2)[row] == pytest.approx(loaded.preview_s)
        alone.append(loaded)
    memory, memories = law.initial(seen[0]), [one.initial(at(seen[0], (row,))) for row, one in enumerate(alone)]
    for now in seen:
        memory, out = law.step(memory, now)
        for row, one in enumerate(alone):
            memories[row], single = one.step(memories[row], at(now, (row,)))
            np.testing.assert_allclose(out.accel_w_mps2[row], single.accel_w_mps2, rtol=1e-9, atol=1e-9)
            np.testing.assert_array_equal(out.event[row], single.event)


def test_a_written_file_keeps_all_but_the_gains() -> None:
    files = read_controller("geometric-pid")
    space = PeerSpace(files)
    again = space.toml(space.start, "companion tune --seed 7")
    assert "# Gains found by `companion tune --seed 7`.\n[gains]\n" in again
    same = PeerSpace(replace(files, text=again))
    assert same.start == pytest.approx(space.start, rel=6e-3)
    assert same.file.tune == space.file.tune
    twice = same.toml(same.start, "companion tune --seed 8")
    assert twice.count("Gains found by") == 1
    assert "  # 1/s^2" in twice


def test_a_number_of_its_own_for_z_is_written_to_z() -> None:
    space = PeerSpace(read_controller("geometric-pid"))
    text = space.toml(space.start | {"kp_per_s2": 5.0, "kp_per_s2.z": 7.0}, "companion tune")
    law = space.law_of({"kp_per_s2": np.array([5.0]), "kp_per_s2.z": np.array([7.0])}, VEHICLE, 0.01)
    assert "kp_per_s2 = [5, 5, 7]" in text
    assert isinstance(law, GeometricPid)
    np.testing.assert_array_equal(law.gains.kp_per_s2, [[5.0, 5.0, 7.0]])


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "has no \\[tune\\]"),
        ("[tune]\nkq = [0.1, 1.0]", "tune.kq: there is no such gain"),
        ('[tune]\n"lead_s.z" = [0.1, 1.0]', "tune.lead_s.z: there is no such gain"),
        ("[tune]\nlead_s = [0.2, 0.1]", "tune.lead_s = \\[0.2, 0.1\\]: must be 0 <= low < high"),
    ],
)
def test_a_mistake_in_the_ranges_is_one_sentence(table: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'law = "indi"\n{table}\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        _ = PeerSpace(read_controller(str(path))).knobs


@pytest.mark.slow
def test_a_trial_flies_the_peers_law() -> None:
    short = scene(Ellipse(CENTRE, (0.4, 0.3), LapTiming(4.0, 1, 1.0)), settle_s=1.0, disturbance=PUSHED)
    space = PeerSpace(read_controller("indi"))
    point = shares_of(space.start | {"send_from_mps2": 0.1}, space.knobs)
    quiet = shares_of(space.start | {"send_from_mps2": 0.9}, space.knobs)
    marks = evaluate(Trial(short, 5, (0,), (1,), space), np.stack((point, quiet)))
    assert marks.error_m[0] < 0.1
    assert marks.update_share[1] < 0.5 * marks.update_share[0]
    assert set(values_of(point[None], space.knobs)) == set(space.file.tune)
