"""Joint vectors and motions for the arms' tests."""

import numpy as np
from hypothesis import strategies as st

from companion.arms.model import JOINT_COUNT
from companion.core.types import Array, JointMotion


def joints(**angles_rad: float) -> Array:
    """All zero but these, named `right_elbow_pitch` and so on."""
    names = [
        f"{side}_{kind}"
        for side in ("right", "left")
        for kind in ("shoulder_pitch", "elbow_pitch", "elbow_roll", "claw")
    ]
    assert set(angles_rad) <= set(names)
    return np.array([angles_rad.get(name, 0.0) for name in names])


def vectors(size: float) -> st.SearchStrategy[Array]:
    """Joint vectors (8,) of values up to `size`."""
    values = st.floats(-size, size)
    return st.lists(values, min_size=JOINT_COUNT, max_size=JOINT_COUNT).map(np.array)


MOTIONS = st.builds(JointMotion, vectors(3.0), vectors(3.0), vectors(20.0))
