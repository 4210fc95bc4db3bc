"""The documentation's picture of the arms can be drawn."""

from pathlib import Path

import numpy as np

from companion.arms.model import ArmModel
from companion.studies.paper.arm_plots import plot_poses


def test_poses_are_drawn_into_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "new" / "poses.png"
    plot_poses(ArmModel(), {"all zero": np.zeros(8), "bent": np.full(8, 0.3)}, path)
    assert path.read_bytes().startswith(b"\x89PNG")
