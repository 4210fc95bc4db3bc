"""Public interface for a control law of your own: import from here alone, so that `control` may be rearranged."""

from companion.control.controller import ControlInput, Controller, ControlOutput, SeededLaw, TwoHalves, VehicleModel
from companion.control.delay_predictor import Predictor, PredictorMemory
from companion.control.gains import Gains, Positive
from companion.core.types import Array
from companion.geometry.array_math import by_axis, dot, length, math_module, times, where

__all__ = [
    "Array",
    "ControlInput",
    "ControlOutput",
    "Controller",
    "Gains",
    "Positive",
    "Predictor",
    "PredictorMemory",
    "SeededLaw",
    "TwoHalves",
    "VehicleModel",
    "by_axis",
    "dot",
    "length",
    "math_module",
    "times",
    "where",
]
