"""Search space of the ET-NN law, with the check of its filter loop."""

from dataclasses import dataclass

import numpy as np

from companion.control.controller import VehicleModel
from companion.control.etnn import Etnn
from companion.core.types import Array
from companion.studies.tuning.controller_writer import controller_toml
from companion.studies.tuning.gain_space import KNOBS, Knob, damping_margin, gain_fields, law_of

_LEAST_MARGIN = 1.05
"""A set whose filter loop is not stable by so much is marked down."""


@dataclass(frozen=True)
class EtnnSpace:
    """Search space of the ET-NN law; `title` and `description` are those of the file that is written."""

    title: str = "A tuned ET-NN law."
    description: str = ""
    knobs: tuple[Knob, ...] = KNOBS

    def law_of(self, values: dict[str, Array], vehicle: VehicleModel, period_s: float) -> Etnn:
        """Return the laws of a batch of points as one law."""
        return law_of(values, vehicle, period_s)

    def previews_s(self, law: Etnn) -> Array:
        """Return the preview of each law, (B,)."""
        assert law.predictor is not None
        return np.asarray(law.predictor.preview_s)[:, 0]

    def penalty(self, points: Array) -> Array:
        """Return the penalty (P,) of sets that fail, or nearly fail, the stability check of the filter loop."""
        return penalty(points)

    def stable(self, values: dict[str, float]) -> bool:
        """Return True if the set passes the stability check of the loader."""
        damping, needed = gain_fields(values).filter_loop()
        return damping > needed

    def toml(self, values: dict[str, float], command: str) -> str:
        """Return a controller file with these values."""
        return controller_toml(values, self.title, self.description, command)


ETNN = EtnnSpace()
"""The space of a search that names no law."""


def penalty(points: Array) -> Array:
    """Return the penalty (P,) of sets that fail, or nearly fail, the stability check of the filter loop."""
    short = _LEAST_MARGIN - damping_margin(points)
    return np.where(short > 0.0, 1.0 + 5.0 * short, 0.0)
