"""A world as ODE holds it: made from the document of ``world.json`` and its sidecar through the part in C (``shim/``).

What the bodies are moved by is said in ``shim/motion.c`` and ``shim/step.c``: before every step they are laid on their joints,
with the wrenches that make ODE's step the step of the joints' coordinates.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from simspec.dialects.ode.sidecar import OdeSidecar
from simspec.engines.kit.hulls import check_solid
from simspec.engines.ode.library import NAME, Library, numbers
from simspec.errors import EngineError
from simspec.formats.world.tree import AxisJoint, BallJoint, Body, Document, FixedJoint, FreeJoint, Joint, parent_of
from simspec.world.types import Hardness, PairContact

ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
KINDS = ("fixed", "hinge", "slide", "ball", "free")
"""As the part in C numbers them."""
SHAPES = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
"""The same of shapes."""
CONES = ("elliptic", "pyramid-circumscribed", "pyramid-inscribed")
"""The same of friction cones."""
SOLVERS = ("step", "quick-step")
"""ODE's, as the setting ``solver`` names them: dWorldStep, dWorldQuickStep."""
SIZES = 3
"""Numbers that a shape of the part in C has for its size, at most."""
Settings = Mapping[str, Any]


class Built:
    """``sim``: the world of the part in C. ``shapes``: (body, name) of every collision shape, in the order of their numbers."""

    def __init__(self, library: Library, document: Document, told: OdeSidecar):
        self.library, self.document = library, document
        self.materials = sorted({shape.material for body in document.bodies for shape in body.shapes if shape.copies})
        self.groups = sorted({body.group for body in document.bodies})
        self.shapes: list[tuple[int, str]] = []
        settings = told.settings
        if settings["solver"] not in SOLVERS:
            raise EngineError(NAME, f"has no solver {settings['solver']!r}")
        if document.friction_cone not in CONES:
            raise EngineError(NAME, f"does not support the friction cone {document.friction_cone}")
        self.sim = library.sim_new(
            numbers(document.gravity),
            document.timestep,
            CONES.index(document.friction_cone),
            SOLVERS.index(str(settings["solver"])),
            int(settings["iterations"]),
            int(settings.get("native_motion", False)),
            len(self.materials),
            len(self.groups),
        )
        rows = {body.name: row for row, body in enumerate(document.bodies)}
        moving: set[str] = set()
        try:
            for body in document.bodies:
                parent = parent_of(body.joint)
                if not isinstance(body.joint, FixedJoint) or parent in moving:
                    moving.add(body.name)
                self._body(body, -1 if parent is None else rows[parent], body.name in moving)
            for row, body in enumerate(document.bodies):
                self._shapes(row, body)
            self._laws(document, told)
            self._filter(document, rows)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        sim, self.sim = self.sim, None
        if sim is not None:
            self.library.sim_free(sim)

    def _body(self, body: Body, parent: int, moves: bool) -> None:
        joint = body.joint
        if moves and not body.mass and any(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no mass")
        if moves and not body.mass and not isinstance(joint, FixedJoint):
            raise EngineError(NAME, f"does not support {body.name!r}, which moves and has no mass")
        if moves and body.mass and not regular(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no inverse")
        if isinstance(joint, AxisJoint) and joint.servo is not None:
            raise EngineError(NAME, f"has no controller of its own, which joint {joint.name!r} has")
        origin = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        if not isinstance(joint, FreeJoint):
            origin = (*joint.origin.position, *joint.origin.quaternion)
        limits = joint.position_limits if isinstance(joint, AxisJoint) else None
        made = self.library.sim_body(
            self.sim,
            KINDS.index(joint.kind),
            parent,
            numbers(origin),
            numbers(joint.axis if isinstance(joint, AxisJoint) else (0.0, 0.0, 0.0)),
            body.mass,
            numbers(body.centre_of_mass),
            numbers(body.inertia),
            numbers((*_losses(joint), *(limits or (-math.inf, math.inf)))),
            limits is not None,
        )
        if made < 0:
            raise EngineError(NAME, f"has no memory for {body.name!r}")

    def _shapes(self, row: int, body: Body) -> None:
        for shape in body.shapes:
            if not shape.copies:
                continue
            made = -1
            if shape.kind == "mesh":
                check_solid(NAME, shape.name, shape.size)
            if shape.kind in SHAPES:
                size = (*shape.size, *[0.0] * SIZES)[: max(SIZES, len(shape.size))]
                made = self.library.sim_shape(
                    self.sim,
                    row,
                    SHAPES.index(shape.kind),
                    numbers(size),
                    len(shape.size) // 3,
                    numbers((*shape.pose.position, *shape.pose.quaternion)),
                    self.materials.index(shape.material),
                    self.groups.index(body.group),
                )
            if made < 0:
                where = "" if shape.kind not in SHAPES else " on a body that moves"
                raise EngineError(NAME, f"does not support the {shape.kind} {shape.name!r}{where}")
            self.shapes.append((row, shape.name))

    def _laws(self, document: Document, told: OdeSidecar) -> None:
        for law in told.laws:
            wrong = not_held(law)
            if wrong:
                raise EngineError(NAME, f"does not support {wrong} of {law.first} and {law.second}")
            one, other = (self.materials.index(name) for name in (law.first, law.second))
            held = (
                law.friction,
                law.restitution,
                law.restitution_threshold,
                law.rolling_friction,
                law.torsional_friction,
                ERROR_REDUCTION,
                float(told.settings["softness"]),
            )
            self.library.sim_law(self.sim, one, other, numbers(held))

    def _filter(self, document: Document, rows: Mapping[str, int]) -> None:
        for one, other in document.apart.groups:
            self.library.sim_ignore(self.sim, self.groups.index(one), self.groups.index(other))
        keys = sorted(
            min(rows[one], rows[other]) * len(rows) + max(rows[one], rows[other])
            for one, other in document.apart.bodies
        )
        self.library.sim_exclude(self.sim, (ctypes.c_longlong * max(1, len(keys)))(*keys), len(keys))


def _losses(joint: Joint) -> tuple[float, ...]:
    """Damping, stiffness, rest, dry friction, armature."""
    if isinstance(joint, AxisJoint):
        return joint.damping, joint.spring_stiffness, joint.spring_rest, joint.dry_friction, joint.armature
    if isinstance(joint, BallJoint):
        return joint.damping, joint.spring_stiffness, 0.0, 0.0, 0.0
    return (0.0,) * 5


def not_held(law: PairContact) -> str | None:
    """What of a law ODE does not have; None where it has all."""
    if law.hardness.kind != "common":
        return f"the hardness {law.hardness.kind}"
    if law.hardness != Hardness():
        return "numbers beside the common hardness"
    if law.margin is not None:
        return "a margin"
    return None


def regular(inertia: tuple[float, ...]) -> bool:
    """Whether ODE can invert a tensor: it takes one that is not positive definite for the identity, without a word."""
    xx, yy, zz, xy, xz, yz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(np.linalg.eigvalsh(tensor)[0] > 0.0)
