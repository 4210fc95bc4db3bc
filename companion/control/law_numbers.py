"""The ET-NN law as numbers alone, as its compiled twin takes it: gains, and the predictor with room for any delay."""

from dataclasses import replace

import numpy as np

from companion.control.controller import VehicleModel
from companion.control.delay_predictor import Predictor, Weights
from companion.control.etnn import EtnnMemory
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import where

COMMANDS = 10
"""Most commands that a compiled predictor remembers; one that remembers fewer has weights of 0 for the older ones."""


@value(kw_only=True)
class Lookahead:
    """Predictor as numbers: its weights for COMMANDS commands, (2, 3, COMMANDS + 2), and how many of them count."""

    vehicle: VehicleModel
    horizon_s: Scalar
    drives: Array
    thrust_share: float
    observer_radps: Scalar
    commands: float


NO_LOOKAHEAD = Lookahead(
    vehicle=VehicleModel(),
    horizon_s=0.0,
    drives=np.zeros((2, 3, COMMANDS + 2)),
    thrust_share=0.0,
    observer_radps=0.0,
    commands=1.0,
)
"""The shapes of these numbers."""


def lookahead_of(predictor: Predictor) -> Lookahead | None:
    """Return a predictor as numbers; None if it remembers more commands than there is room for."""
    weights = predictor.weights
    commands = weights.drives.shape[-1] - 2
    if commands > COMMANDS:
        return None
    return Lookahead(
        vehicle=predictor.vehicle,
        horizon_s=weights.horizon_s,
        drives=_with_room(weights.drives),
        thrust_share=predictor.thrust_share,
        observer_radps=predictor.observer_radps,
        commands=float(commands),
    )


def with_room(memory: EtnnMemory) -> EtnnMemory:
    """Return a memory whose predictor has room for COMMANDS commands."""
    assert memory.predictor is not None
    return replace(memory, predictor=replace(memory.predictor, drives=_with_room(memory.predictor.drives)))


def _with_room(drives: Array) -> Array:
    older = np.zeros((*drives.shape[:-1], COMMANDS + 2 - drives.shape[-1]))
    return np.concatenate((older, drives), axis=-1)


class NumberedPredictor(Predictor):
    """Predictor with room for COMMANDS commands."""

    def __init__(self, lookahead: Lookahead) -> None:
        weights = Weights(lookahead.horizon_s, lookahead.drives)
        self.__dict__.update(vars(lookahead) | {"weights": weights})

    def _oldest(self, drives: Array) -> Array:
        oldest, count = drives[..., COMMANDS - 1], self.__dict__["commands"]
        for commands in range(2, COMMANDS + 1):
            oldest = where(count == float(commands), drives[..., COMMANDS - commands], oldest)
        return oldest
