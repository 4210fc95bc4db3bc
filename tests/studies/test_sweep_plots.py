"""The picture of a sweep."""

import numpy as np
import pytest

from companion.studies.sweep.sweep import ERROR, Columns
from companion.studies.sweep.sweep_numbers import PARAMETERS
from companion.studies.sweep.sweep_plots import sweep_figure

pytestmark = pytest.mark.slow


def test_every_parameter_has_a_panel_of_its_own_and_so_has_the_ranking() -> None:
    count = 20
    columns: Columns = {name: np.linspace(0.0, 1.0, count) for name in (*PARAMETERS, ERROR, "update_share")}
    columns |= {"nominal_radps": np.full(count, 12.0), "diverged": np.zeros(count, bool)}
    columns["experiment"] = np.array(["ellipse", "figure8"] * (count // 2))
    axes = sweep_figure(columns, "a sweep").get_axes()
    assert len(axes) == len(PARAMETERS) + 1
    cells = [cell for one in axes if (place := one.get_subplotspec()) for cell in range(place.num1, place.num2 + 1)]
    assert len(cells) == len(set(cells)) > len(PARAMETERS)
