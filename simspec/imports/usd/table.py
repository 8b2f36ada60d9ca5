"""What prims and attributes of a stage become, as rows of the documentation, and the rules of repair."""

from __future__ import annotations

from typing import Final

from simspec.imports.moments import NOT_POSITIVE
from simspec.imports.table import Row
from simspec.imports.usd.fates import ATTRIBUTES, NEUTRAL, TYPES
from simspec.imports.usd.masses import AS_UNSAID

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
    (
        "PhysicsRigidBodyAPI/@physxRigidBody:disableGravity",
        "`gravity_scale: 0`, where it is true",
    ),
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


def rows() -> list[Row]:
    """What is carried, then what is not."""
    carried = [Row(where, becomes) for where, becomes in _CARRIED]
    types = [Row(rule.shown, "", rule.fate, rule.severity, rule.reason, rule.hint) for rule in TYPES]
    attributes = [
        Row(rule.shown.replace("`", ""), "", rule.fate, rule.severity, rule.reason, rule.hint)
        for rule in (*NEUTRAL, *ATTRIBUTES)
    ]
    return [*carried, *types, *attributes]
