"""The written tree: a model of the MJCF language as plain values, which ``templates/mjcf/`` prints in this order.

Frames and units are the language's (m, kg, s, and rad where ``compiler`` says so): a body's frame is in its parent's, a
joint's and a shape's in their body's; quaternions are w x y z; lengths of shapes are halved where the language wants that.
"""

from __future__ import annotations

from dataclasses import dataclass

from simspec.world.types import Quaternion, Vector3

Value = bool | int | float | str | tuple[float, ...]
Attributes = tuple[tuple[str, Value], ...]
"""Names and values, in the order in which they are printed."""


@dataclass(frozen=True, slots=True)
class MjcfInertial:
    """Mass (kg), centre of mass (m), and principal moments (kg m²) in axes turned by ``orientation``."""

    position: Vector3
    orientation: Quaternion
    mass: float
    moments: Vector3


@dataclass(frozen=True, slots=True)
class MjcfJoint:
    """A joint: ``hinge``, ``slide``, ``ball`` or ``free``."""

    name: str
    type: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfMesh:
    """A convex hull: its name, its ``vertices`` (flat, m) as they stand in a file of their own, called ``file``."""

    name: str
    file: str
    vertices: tuple[float, ...]
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfHeightField:
    """A height field: its name, rows and columns, ``size`` (half lengths along x and y, height of the highest point over the
    lowest, base; m), and the ``elevation`` of its points as shares of that height, the row of the greatest y first."""

    name: str
    rows: int
    columns: int
    size: tuple[float, ...]
    elevation: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class MjcfGeom:
    """A shape. ``class_name``: the class of defaults that it takes; empty: its body's. ``mesh``, ``hfield``: the mesh or the
    height field that it is, which has no ``size``."""

    name: str
    type: str
    size: tuple[float, ...]
    position: Vector3
    orientation: Quaternion
    class_name: str = ""
    more: Attributes = ()
    mesh: str = ""
    hfield: str = ""


@dataclass(frozen=True, slots=True)
class MjcfSite:
    """A frame in a body."""

    name: str
    position: Vector3
    orientation: Quaternion


@dataclass(frozen=True, slots=True)
class MjcfBody:
    """A body. ``depth``: how many bodies it stands in; bodies are listed depth first, so that none refers to its parent."""

    name: str
    position: Vector3
    orientation: Quaternion
    depth: int = 0
    inertial: MjcfInertial | None = None
    joints: tuple[MjcfJoint, ...] = ()
    geoms: tuple[MjcfGeom, ...] = ()
    more: Attributes = ()
    sites: tuple[MjcfSite, ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfDefault:
    """Defaults by element. The model's own have no name, and its classes take them over."""

    name: str = ""
    elements: tuple[tuple[str, Attributes], ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfPair:
    """An explicit pair of shapes."""

    geom1: str
    geom2: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfExclude:
    """Two bodies whose shapes do not touch."""

    body1: str
    body2: str


@dataclass(frozen=True, slots=True)
class MjcfEquality:
    """A constraint; ``type`` is its element."""

    type: str
    name: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfTendon:
    """A fixed tendon: joints by name, each with its coefficient."""

    name: str
    joints: tuple[tuple[str, float], ...]
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfActuator:
    """An actuator of a joint; ``type`` is its element."""

    type: str
    name: str
    joint: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfKey:
    """A keyframe: the coordinates and velocities of all joints, and the controls of all actuators, in the order of the file."""

    name: str
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    control: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfModel:
    """One file."""

    name: str
    compiler: Attributes = ()
    option: Attributes = ()
    flags: tuple[tuple[str, bool], ...] = ()
    size: Attributes = ()
    default: MjcfDefault = MjcfDefault()
    classes: tuple[MjcfDefault, ...] = ()
    bodies: tuple[MjcfBody, ...] = ()
    pairs: tuple[MjcfPair, ...] = ()
    excludes: tuple[MjcfExclude, ...] = ()
    actuators: tuple[MjcfActuator, ...] = ()
    keys: tuple[MjcfKey, ...] = ()
    meshes: tuple[MjcfMesh, ...] = ()
    heightfields: tuple[MjcfHeightField, ...] = ()
    equalities: tuple[MjcfEquality, ...] = ()
    tendons: tuple[MjcfTendon, ...] = ()
