"""The importer of USD: stages with the schemas of UsdPhysics."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from simspec.imports.draft import NOT_POSITIVE, Draft
from simspec.imports.elements import APPEARANCE, INFORMATION, LOST, PHYSICS, UNUSED
from simspec.imports.files import Files
from simspec.imports.reference import ElementRow
from simspec.imports.usd import SUFFIXES
from simspec.imports.usd.assembly import UsdAssembly
from simspec.imports.usd.bodies import AS_UNSAID
from simspec.imports.usd.shapes import ROTATIONS
from simspec.imports.usd.stage import PrimRead, StageRead, read_stage
from simspec.language.foreign import Fate, Imported, ImportOptions, LossSeverity

# Fates of prims and attributes that no reader takes, by type and name, and the rows of the documentation.


class LossRule(NamedTuple):
    """Names that a regular expression fits, and what becomes of them."""

    pattern: re.Pattern[str]
    shown: str
    fate: Fate
    severity: LossSeverity
    reason: str
    hint: str = ""


def _lost(pattern: str, shown: str, severity: LossSeverity, reason: str, hint: str = "") -> LossRule:
    return LossRule(re.compile(pattern), shown, LOST, severity, reason, hint)


def _unused(pattern: str, shown: str, reason: str) -> LossRule:
    return LossRule(re.compile(pattern), shown, UNUSED, INFORMATION, reason)


FLAGS: Final = (
    "actuation",
    "constraint",
    "contact",
    "damper",
    "equality",
    "filterparent",
    "frictionloss",
    "gravity",
    "limit",
    "spring",
)
"""Parts of the physics of a scene that ``mjc:flag:NAME`` switches off."""
TYPES: Final = (
    _lost(".*Light|LightFilter", "lights", APPEARANCE, "simspec has no lights"),
    _lost("Camera", "Camera", APPEARANCE, "simspec has no cameras"),
    _lost("Shader|NodeGraph", "Shader, NodeGraph", APPEARANCE, "a shape has one colour"),
    _lost("GeomSubset", "GeomSubset", APPEARANCE, "a shape has one material and one colour"),
    _lost("Render.*", "RenderSettings and others", APPEARANCE, "of programs that draw"),
    _lost("Skel.*|BlendShape", "SkelRoot and others", APPEARANCE, "simspec has no skins"),
    _lost(
        "PointInstancer", "PointInstancer", PHYSICS, "simspec does not read instances of points", "write each as a prim"
    ),
    _lost(
        "BasisCurves|NurbsCurves|HermiteCurves|Points|NurbsPatch|Volume",
        "curves, points, volumes",
        APPEARANCE,
        "they do not collide, and simspec does not draw them",
    ),
    _lost(
        "MjcActuator|NewtonActuator",
        "MjcActuator, NewtonActuator",
        INFORMATION,
        "a drive of a joint is `control` in a spec",
    ),
    _lost("MjcTendon", "MjcTendon", PHYSICS, "tendons of a stage are not read", "import the file that it is made from"),
    _lost("MjcKeyframe", "MjcKeyframe", INFORMATION, "a named state of one engine"),
    _lost("OmniGraph.*|ComputeGraph.*", "graphs of programs", INFORMATION, "of other programs"),
    _lost("TetMesh", "TetMesh", PHYSICS, "deformable bodies are not supported"),
)
"""Prims of these types are not read."""
NEUTRAL: Final = (
    _unused(
        "physics:linearVelocity|physxRigidBody:(linear|angular)Damping|physxRigidBody:disableGravity"
        "|physxMaterial:compliantContact.*|newton:.*|mjc:option:(density|viscosity|wind)|mjc:flag:override"
        "|mjc:(margin|gap|priority|ref|springdamper|springref|stiffness|damping|frictionloss|armature|shellinertia)"
        "|mjc:(actuator.*|coef[0-4]|body:gravcomp)|mjc:compiler:(balanceInertia|boundMass|boundInertia)|physxJoint:.*|physxJointAxis:.*",
        "damping, velocities, margins and switches of zero",
        "of no effect, since it is zero",
    ),
)
"""Attributes that UsdPhysics does not have, where their value is zero, false, or the infinity that stands for none."""
DEFAULTS: Final[Mapping[str, object]] = {
    **{f"mjc:flag:{name}": True for name in FLAGS},
    "mjc:condim": 3,
    "mjc:compiler:inertiaFromGeom": "auto",
    "mjc:compiler:setTotalMass": -1.0,
    "newton:massModel": "solid",
    "newton:maxHullVertices": -1,
    "mjc:maxhullvert": -1,
    "mjc:torqueScale": 1.0,
    "mjc:actuatorfrclimited": "auto",
    "physxRigidBody:enableGyroscopicForces": True,
}
"""Attributes with the value that is as if they were not there."""
OF_SENSORS: Final = re.compile(r"(sensor|transmission|ros2_control|hardwareInterface|plugin)(_\d+)?")
"""Names of prims that a converter makes of elements of URDF without a place in USD: their attributes begin with ``urdf:``."""
AS_DEFAULT: Final = _unused(".*", "", "its default: as without it")
"""Of :data:`DEFAULTS`."""
ATTRIBUTES: Final = (
    _unused(
        "physics:approximation|apiSchemas:PhysicsMeshCollisionAPI",
        "`physics:approximation` of other prims than meshes",
        "only meshes are approximated",
    ),
    _lost("apiSchemas:.*", "other schemas", INFORMATION, "its attributes are reported one by one"),
    _unused("xformOp.*", "`xformOp:…` of prims that nothing stands in", "nothing that is carried stands there"),
    _lost(
        "extent|extentsHint|doubleSided|orientation|visibility|purpose|proxyPrim|primvars:.*|normals|velocities|accelerations",
        "`extent`, `doubleSided`, `primvars:…`, `normals` and others",
        APPEARANCE,
        "a shape has one colour",
    ),
    _lost(
        "subdivision.*|interpolateBoundary|faceVaryingLinearInterpolation|triangleSubdivisionRule|corner.*|crease.*|holeIndices|subset.*",
        "`subdivisionScheme` and others",
        APPEARANCE,
        "a mesh is its points",
    ),
    _lost(
        "metallic|roughness|material:binding(:.*)?|inputs:.*|outputs:.*|info:.*|displayName",
        "`material:binding`, `inputs:…`, `outputs:…`",
        APPEARANCE,
        "a shape has one colour",
    ),
    _lost(
        "ui:.*|omni:.*|semantic.*|isaac:.*|kind|documentation|userProperties:.*|debug:.*|clips.*|Fabric:.*|physics:engine"
        "|physics:tensor:.*|physics:newton:articulation_index|mjc[f]:.*|warpSim:.*|TimeStepsPerSecond|state:.*:appliedForce",
        "`ui:…`, `omni:…`, `semantic…`, `warpSim:…` and others",
        INFORMATION,
        "of other programs",
    ),
    _lost(
        f"mjc:flag:({'|'.join(FLAGS)}|override)|mjc:option:(density|viscosity|wind|o_.*)"
        "|mjc:compiler:(balanceInertia|boundMass|boundInertia|setTotalMass|inertiaFromGeom)",
        "`mjc:flag:contact` and others, `mjc:option:density`, `viscosity`, `wind`, other than their defaults",
        PHYSICS,
        "of one engine: UsdPhysics does not have it",
    ),
    _lost(
        "physxScene:.*|newton:(max_solver_iterations|maxSolverIterations|timeStepsPerSecond|.*[Ii]teration.*)"
        "|newton:(kamino|xpbd|vbd|mpm):.*|mjc:(option|compiler|flag):.*"
        "|physx(Articulation|RigidBody):(solver.*|sleep.*|stabilization.*|maxDepenetrationVelocity|retainAccelerations)"
        "|physxMaterial:improvePatchFriction",
        "`physxScene:…`, `mjc:option:…`, `newton:kamino:…`, and others",
        INFORMATION,
        "settings of one engine's solver",
    ),
    _lost(
        "mjc:sol(ref|imp|mix).*|mjc:torqueScale|physxLimit:.*:(stiffness|damping)|newton:limit(Stiffness|Damping)"
        "|newton:contact(Stiffness|Damping|FrictionGain)|physxMaterial:compliantContact.*",
        "`mjc:solref`, `mjc:solimp`, `newton:contactStiffness`, stiffness and damping of limits",
        INFORMATION,
        "how hard contact, constraints and limits are",
    ),
    _lost(
        "newton:contactGap|mjc:gap|mjc:margin|physxCollision:contactOffset",
        "`newton:contactGap`, `mjc:gap`, `mjc:margin` of a joint, `physxCollision:contactOffset`",
        INFORMATION,
        "a distance at which contact or a limit is looked for, without a force",
    ),
    _lost("mjc:group", "`mjc:group`", INFORMATION, "of a viewer"),
    _lost(
        "urdf:(safety_controller|calibration):.*",
        "`urdf:safety_controller:…`, `urdf:calibration:…`",
        INFORMATION,
        "of a controller, and of a machine's own sensors",
    ),
    _lost(
        "physx.*:.*|newton:.*|mjc:.*",
        "`physx…`, `newton:…`, `mjc:…`",
        PHYSICS,
        "of one engine: UsdPhysics does not have it",
    ),
    _unused("variantSets:.*", "variant sets", "the chosen variant is read"),
    _unused("timeCodesPerSecond|framesPerSecond|startTimeCode|endTimeCode", "time codes", "nothing is animated"),
    _unused("simspec:.*", "`simspec:…`", "nothing here needs it"),
)


def settle(stage: StageRead) -> None:
    """Say of every prim and attribute that nothing took what becomes of it."""
    for prim in stage.prims.values():
        if not prim.used:
            prim.ignore(None, "inactive, abstract, or not defined")
            continue
        rule = next((rule for rule in TYPES if rule.pattern.fullmatch(prim.tag)), None)
        if prim._fate is False:
            if rule is not None:
                prim.set_aside(None, rule.fate, rule.reason, rule.severity, rule.hint)
            else:
                prim.take()
        foreign = any(OF_SENSORS.fullmatch(around.name) for around in prim.ancestors())
        for name in prim.attributes:
            if foreign and name.startswith("urdf:"):
                prim.lose(name, "of sensors and actuators, as a URDF describes them", INFORMATION)
            if name in prim._taken or name in prim._fates:
                continue
            said = (
                rule
                or _neutral(prim, name)
                or next((attribute for attribute in ATTRIBUTES if attribute.pattern.fullmatch(name)), None)
            )
            if said is not None and prim._fate is True:
                prim.set_aside(name, said.fate, said.reason, said.severity, said.hint)


def _neutral(prim: PrimRead, name: str) -> LossRule | None:
    """The rule of an attribute whose value is zero, or its default, where that is as if it were not there."""
    value = prim.record["attributes"].get(name, {}).get("value")
    if name in DEFAULTS and value == DEFAULTS[name]:
        return AS_DEFAULT
    numbers = value if isinstance(value, list) else [value]
    if name.startswith("newton:"):
        numbers = [0.0 if number in ("-inf", "inf") else number for number in numbers]
    if any(not isinstance(number, (bool, int, float)) or number for number in numbers):
        return None
    return next((entry for entry in NEUTRAL if entry.pattern.fullmatch(name)), None)


RULES: Final = {
    "missing-files": "layers that are not there are left out",
    "empty-shapes": "collision shapes that have no volume, or cannot be read, are left out",
    "incomplete-inertial": "moments that are missing are those of a ball of 1000 kg/m³",
    NOT_POSITIVE: AS_UNSAID,
    "triangle-inequality": "moments that no body has become the nearest ones that a body can have",
    "unit-rotations": "quaternions of another length than 1 become unit quaternions",
    "massless": "a root without mass that nothing holds is fixed to the world",
}
"""Rules of repair, with what they do."""

_CARRIED: Final = (
    ("stage/@metersPerUnit", "lengths in m"),
    ("stage/@kilogramsPerUnit", "masses in kg"),
    ("stage/@upAxis", "the world is turned where y is up"),
    ("PhysicsScene", "`physics`"),
    ("PhysicsScene/@physics:gravityDirection", "`physics.gravity`"),
    ("PhysicsScene/@physics:gravityMagnitude", "`physics.gravity`"),
    ("PhysicsRigidBodyAPI", "`bodies.NAME`"),
    ("PhysicsRigidBodyAPI/@xformOp:…", "`pose`, of a root; where a joint stands initially"),
    ("PhysicsRigidBodyAPI/@physics:rigidBodyEnabled", "shapes of the world where it is false"),
    ("PhysicsRigidBodyAPI/@physics:velocity", "`velocity.linear` of a free root"),
    ("PhysicsRigidBodyAPI/@physics:angularVelocity", "`velocity.angular` of a free root"),
    ("PhysicsRigidBodyAPI/@physxRigidBody:disableGravity", "`gravity_scale: 0`, where it is true"),
    ("PhysicsMassAPI/@physics:mass", "`mass`"),
    ("PhysicsMassAPI/@physics:density", "`shapes.N.density`"),
    ("PhysicsMassAPI/@physics:centerOfMass", "`centre_of_mass`"),
    ("PhysicsMassAPI/@physics:diagonalInertia", "`inertia`"),
    ("PhysicsMassAPI/@physics:principalAxes", "`inertia`"),
    ("NewtonMassAPI/@newton:inertia", "`inertia`, in place of moments and axes"),
    ("PhysicsScene/@newton:gravityEnabled", "`physics.gravity` of 0, where it is false"),
    ("PhysicsRigidBodyAPI/@mjc:body:gravcomp", "`gravity_scale`: 1 less it"),
    ("PhysicsJoint/@newton:damping", "`joint.damping`, per degree of an angle; `mjc:damping` per radian"),
    ("PhysicsJoint/@newton:friction", "`joint.dry_friction`; and `mjc:frictionloss`"),
    ("PhysicsJoint/@newton:velocityLimit", "`joint.limits.velocity`; and `physxJoint:maxJointVelocity`"),
    ("PhysicsJoint/@mjc:actuatorfrcrange:…", "`joint.limits.effort`, where it is symmetric; and `urdf:limit:effort`"),
    ("NewtonMimicAPI", "`constraints.NAME.follow`; and `PhysxMimicJointAPI`"),
    (
        "PhysicsArticulationRootAPI/@newton:jointsAddMobility",
        "several joints of two bodies are the `joints` of one body",
    ),
    ("PhysicsCollisionAPI/@newton:contactMargin", "`shapes.N.margin`; and `mjc:margin`"),
    ("Mesh/@newton:maxHullVertices", "`mesh.max_vertices`"),
    (
        "Material/@newton:torsionalFriction",
        "`torsional_friction`, of shapes with `mjc:condim` of 4, or where no shape says it",
    ),
    (
        "Material/@newton:rollingFriction",
        "`rolling_friction`, of shapes with `mjc:condim` of 6, or where no shape says it",
    ),
    ("Cube", "`box`"),
    ("Sphere", "`sphere`; with several factors `ellipsoid`"),
    ("Cylinder", "`cylinder`"),
    ("Capsule", "`capsule`"),
    ("Cone", "`mesh`: the hull of its tip and a polygon of 64 corners"),
    ("Plane", "`plane`"),
    ("Mesh", "`mesh`: its convex hull"),
    ("PhysicsCollisionAPI", "a shape that collides; others have `collision: false`"),
    ("Mesh/@purpose", "`visual: false` for guide and proxy"),
    ("Mesh/@primvars:displayColor", "`shapes.N.colour`"),
    ("PhysicsMaterialAPI/@physics:dynamicFriction", "`contact.materials.NAME.friction`"),
    ("PhysicsMaterialAPI/@physics:restitution", "`contact.materials.NAME.restitution`"),
    ("PhysicsMaterialAPI/@physics:density", "`shapes.N.density`"),
    ("PhysicsRevoluteJoint", "`joint` of type hinge"),
    ("PhysicsPrismaticJoint", "`joint` of type slide"),
    ("PhysicsSphericalJoint", "`joint` of type ball"),
    ("PhysicsFixedJoint", "`joint` of type fixed"),
    ("PhysicsJoint", "`joint`, or `joints`: its free axes, slides before turns, each in the order X, Y, Z"),
    ("PhysicsJoint/@physics:localPos0", "`joint.origin`"),
    ("PhysicsJoint/@physics:localRot0", "`joint.origin`"),
    ("PhysicsJoint/@physics:localPos1", "the body's frame, which moves there"),
    ("PhysicsJoint/@physics:localRot1", "`joint.axis`"),
    ("PhysicsJoint/@physics:lowerLimit", "`joint.limits.position`"),
    ("PhysicsJoint/@physics:upperLimit", "`joint.limits.position`"),
    ("PhysicsJoint/@physics:excludeFromArticulation", "a loop: `constraints`"),
    ("PhysicsJoint/@physxJoint:armature", "`joint.armature`"),
    ("PhysicsJoint/@newton:armature", "`joint.armature`"),
    ("PhysicsJoint/@mjc:armature", "`joint.armature`"),
    ("PhysicsJoint/@mjc:damping", "`joint.damping`"),
    ("PhysicsJoint/@mjc:stiffness", "`joint.spring`"),
    ("PhysicsJoint/@mjc:springref", "`joint.spring.rest`"),
    ("PhysicsJoint/@mjc:frictionloss", "`joint.dry_friction`"),
    ("PhysicsJoint/@state:…velocity", "`joint.velocity`"),
    ("PhysicsDriveAPI/@…stiffness", "`joint.spring`"),
    ("PhysicsDriveAPI/@…damping", "`joint.damping`"),
    ("PhysicsDriveAPI/@…targetPosition", "`joint.spring.rest`"),
    ("PhysicsFilteredPairsAPI/@physics:filteredPairs", "`contact.exclude`"),
    ("PhysicsCollisionGroup", "`contact.groups`, `collision_group`"),
    ("PhysicsArticulationRootAPI", "the root of its tree"),
    ("…/@simspec:…", "the same in doubles, where both agree to single precision"),
)


def rows() -> list[ElementRow]:
    """Rows of carried words, then those of losses."""
    carried = [ElementRow(where, becomes) for where, becomes in _CARRIED]
    types = [ElementRow(rule.shown, "", rule.fate, rule.severity, rule.reason, rule.hint) for rule in TYPES]
    attributes = [
        ElementRow(rule.shown.replace("`", ""), "", rule.fate, rule.severity, rule.reason, rule.hint)
        for rule in (*NEUTRAL, *ATTRIBUTES)
    ]
    return [*carried, *types, *attributes]


MISSING: Final = "missing-files"


class UsdImporter:
    """Reads ``.usda``, ``.usdc`` and ``.usd``, also those that refer to others, and packages of them (``.usdz``)."""

    NAME: Final = "USD"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        return re.match(rb"#usda|PXR-USDC|PK\x03\x04", content) is not None

    @staticmethod
    def table() -> list[ElementRow]:
        """The fates of prims and attributes."""
        return rows()

    @staticmethod
    def rules() -> dict[str, str]:
        """The rules of repair."""
        return dict(RULES)

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        """A stage as a spec. Raises SpecError with every problem."""
        files = Files(path, shown, options)
        draft = Draft(files, options, RULES)
        stage = read_stage(files, draft.repairing(MISSING))
        for prim in stage.prims.values():
            prim.forgiving = draft.repairing(ROTATIONS)
        assembly = UsdAssembly(stage, draft)
        assembly.fill()
        for text in stage.missing:
            draft.repaired(MISSING, stage.root, f"{text} is left out: it is not there", ())
        draft.finish()
        settle(stage)
        draft.made.update(draft.meshes)
        return draft.imported(assembly.data, list(stage.root.accounts()))
