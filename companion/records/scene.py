"""The 3D scene for Foxglove: vehicle, arms by forward kinematics, reference and the way it took."""

from collections import deque
from typing import Any

import numpy as np
from foxglove import Context
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Vector3,
)

from companion.arms.kinematics import points_flu_m
from companion.arms.model import ArmModel
from companion.core.types import Array
from companion.records.channels import stamp
from companion.records.row_codec import RecordRow

_PERIOD_NS = 50_000_000
_STATIC_NS = 1_000_000_000
"""Period at which constant parts are sent again, for viewers that have joined."""
_PATH_POINTS = 600
_ORIGIN = np.zeros(3)
_BALL = Vector3(x=0.06, y=0.06, z=0.06)
_NO_TURN = Quaternion(w=1.0)
_DARK, _GREY = Color(r=0.2, g=0.2, b=0.25, a=1.0), Color(r=0.6, g=0.6, b=0.65, a=0.5)
_ARM, _REFERENCE = Color(r=0.9, g=0.5, b=0.1, a=1.0), Color(r=0.1, g=0.7, b=0.2, a=1.0)
_FLOWN = Color(r=0.1, g=0.4, b=0.9, a=1.0)


class Scene:
    """Draws at most twenty times a second."""

    def __init__(self, context: Context) -> None:
        self._frames = FrameTransformsChannel("/tf", context=context)
        self._scene = SceneUpdateChannel("/scene", context=context)
        self.arms: ArmModel | None = None
        """None: a vehicle without."""
        self._drawn_ns = self._told_ns = 0
        self._reference: deque[Point3] = deque(maxlen=_PATH_POINTS)
        self._flown: deque[Point3] = deque(maxlen=_PATH_POINTS)

    def draw(self, row: RecordRow, time_ns: int, recorded: bool) -> None:
        """Draw one row, where it is recorded or watched."""
        if not (recorded or self._scene.has_sinks() or self._frames.has_sinks()):
            return
        if abs(time_ns - self._drawn_ns) < _PERIOD_NS or "position_w_m" not in row:
            return
        self._drawn_ns = time_ns
        w, x, y, z = row.cell("q_w_flu_wxyz").tolist()
        pose = FrameTransform(
            timestamp=stamp(time_ns),
            parent_frame_id="world",
            child_frame_id="vehicle",
            translation=_vector(row.cell("position_w_m")),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )
        self._frames.log(FrameTransforms(transforms=[pose]), log_time=time_ns)
        self._scene.log(SceneUpdate(entities=self._entities(row, time_ns)), log_time=time_ns)

    def _entities(self, row: RecordRow, time_ns: int) -> list[SceneEntity]:
        entities = []
        if abs(time_ns - self._told_ns) >= _STATIC_NS:
            self._told_ns = time_ns
            entities.append(self._vehicle(time_ns))
        if self.arms is not None and "joint_position_rad" in row:
            entities += self._arms(self.arms, row.cell("joint_position_rad"), time_ns)
        self._flown.append(_point(row.cell("position_w_m")))
        lines, spheres = [_line(list(self._flown), 0.01, _FLOWN)], []
        if "reference_position_w_m" in row:
            reference_w_m = row.cell("reference_position_w_m")
            self._reference.append(_point(reference_w_m))
            lines.append(_line(list(self._reference), 0.01, _REFERENCE))
            spheres = [SpherePrimitive(pose=_at(reference_w_m), size=_BALL, color=_REFERENCE)]
        entities.append(_entity("way", "world", time_ns, lines=lines, spheres=spheres))
        return entities

    @staticmethod
    def _arms(model: ArmModel, joints_rad: Array, time_ns: int) -> list[SceneEntity]:
        if not np.isfinite(joints_rad).all():
            return []
        arms = points_flu_m(model, joints_rad)
        lines = [_line([_point(point) for point in arm], 2.0 * model.link_radius_m, _ARM) for arm in arms]
        return [_entity("arms", "vehicle", time_ns, lines=lines)]

    def _vehicle(self, time_ns: int) -> SceneEntity:
        model = self.arms or ArmModel()
        body = CubePrimitive(pose=_at(_ORIGIN), size=_vector(2.0 * np.array(model.body_half_flu_m)), color=_DARK)
        rotors = model.propellers
        angles = rotors.first_rad + 2.0 * np.pi * np.arange(rotors.count) / rotors.count
        size = Vector3(x=2.0 * rotors.radius_m, y=2.0 * rotors.radius_m, z=0.01)
        centres = [
            np.array([rotors.centre_m * np.cos(angle), rotors.centre_m * np.sin(angle), rotors.height_m])
            for angle in angles
        ]
        discs = [
            CylinderPrimitive(pose=_at(centre), size=size, bottom_scale=1.0, top_scale=1.0, color=_GREY)
            for centre in centres
        ]
        return _entity("vehicle", "vehicle", time_ns, cubes=[body], cylinders=discs)


def _entity(name: str, frame: str, time_ns: int, **primitives: Any) -> SceneEntity:
    return SceneEntity(timestamp=stamp(time_ns), frame_id=frame, id=name, frame_locked=True, **primitives)


def _vector(xyz: Array) -> Vector3:
    x, y, z = xyz.tolist()
    return Vector3(x=x, y=y, z=z)


def _point(xyz: Array) -> Point3:
    x, y, z = xyz.tolist()
    return Point3(x=x, y=y, z=z)


def _at(xyz: Array) -> Pose:
    return Pose(position=_vector(xyz), orientation=_NO_TURN)


def _line(points: list[Point3], thickness: float, color: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip, points=points, thickness=thickness, color=color,
        pose=_at(_ORIGIN), scale_invariant=False,
    )  # fmt: skip
