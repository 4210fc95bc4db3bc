"""QTM's rigid bodies: those its settings list, and which body of a frame is ours; pure.

A frame has no names: its bodies stand in the order of the settings, which change when a user adds, deletes,
renames, reorders or disables a body in QTM.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from companion.adapters.qualisys.packets import MalformedError

_RELATIVE = "1"
"""QTM's type of a body's coordinate system: 0 the room's, 1 another body's, 2 a fixed one (qualisys_cpp_sdk,
`EOriginType`)."""
_MOST_NAMES = 20


@dataclass(frozen=True)
class RigidBody:
    """One body of QTM's settings."""

    name: str
    enabled: bool = True
    """Tracked; RT protocol 1.24 and newer tell."""
    relative: bool = False
    """Its pose is given relative to another body; RT protocol 1.21 and newer tell."""


def rigid_bodies(xml: bytes) -> tuple[RigidBody, ...]:
    """Read the answer to `getparameters 6d`; MalformedError when it is no XML."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314 - expat refuses entity bombs since 2.4.1
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter two for its encoding
        raise MalformedError(f"settings that are no XML ({error})") from error
    return tuple(_body(body) for body in root.findall("The_6D/Body"))


def _body(body: Element) -> RigidBody:
    enabled, origin = body.findtext("Enabled") or "true", body.findtext("Data_origin") or "0"
    return RigidBody(
        name=(body.findtext("Name") or "").strip(),
        enabled=enabled.strip().lower() != "false",
        relative=origin.strip() == _RELATIVE,
    )


def objection(bodies: Sequence[RigidBody], name: str) -> str:
    """Return why the body `name` cannot be flown by, as the end of a sentence that begins with 'QTM at ...'; or ''."""
    ours = [body for body in bodies if body.name == name]
    if not bodies:
        return f"has no rigid bodies: define '{name}' in its 6DOF settings"
    if not ours:
        return f"does not know the body '{name}'; it has: {listed(bodies)}"
    if len(ours) > 1:
        return f"has {len(ours)} bodies called '{name}', and nobody can tell which is the vehicle: rename the others"
    if not ours[0].enabled:
        return f"does not track '{name}': it is disabled there; enable it on the page 6DOF tracking"
    if ours[0].relative:
        return (
            f"gives the pose of '{name}' relative to another body: on the page 6DOF tracking let its coordinate system "
            "be the global one"
        )
    return ""


def listed(bodies: Sequence[RigidBody]) -> str:
    """Name the bodies in their order."""
    names = [body.name + ("" if body.enabled else " (disabled)") for body in bodies[:_MOST_NAMES]]
    return ", ".join([*names, "..."] if len(bodies) > _MOST_NAMES else names)


def index_in_frame(bodies: Sequence[RigidBody], name: str, count: int) -> int | None:
    """Return the index of `name` among the `count` bodies of a frame; None when the frame is not of these settings.

    Whether QTM leaves disabled bodies out of its frames is not documented: the count tells.
    """
    present = _in_frame(bodies, count)
    return None if present is None else [body.name for body in present].index(name)


def others_in_frame(bodies: Sequence[RigidBody], names: Sequence[str], count: int) -> tuple[int | None, ...]:
    """Return the index of each other vehicle's body in a frame; None for one that QTM gives no single pose in W for."""
    known = [body.name for body in _in_frame(bodies, count) or ()]
    return tuple(None if other_objection(bodies, name) else known.index(name) for name in names)


def other_objection(bodies: Sequence[RigidBody], name: str) -> str:
    """Return why QTM does not show where another vehicle's body `name` is, as `objection` does; empty if it does."""
    return objection(bodies, name).replace("which is the vehicle", "which is the other vehicle")


def _in_frame(bodies: Sequence[RigidBody], count: int) -> Sequence[RigidBody] | None:
    for present in (bodies, [body for body in bodies if body.enabled]):
        if len(present) == count:
            return present
    return None


def misfit(bodies: Sequence[RigidBody], count: int) -> str:
    """Say, as `objection` does, that frames hold another number of bodies than the settings."""
    if count == 0:
        return (
            "sends frames without rigid bodies: switch on Project options > Processing > Real-time actions > "
            "Calculate 6DOF"
        )
    return f"sends frames of {count} rigid bodies, and its settings have {len(bodies)}: {listed(bodies)}"
