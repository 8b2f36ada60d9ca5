"""Stages of USD for tests, and what of their import is lost."""

from simspec.language.foreign import ImportOptions, LossSeverity
from simspec.language.load import load

BALL = 'def Sphere "%s" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {\n%s\n}\n'
JOINT = """def PhysicsRevoluteJoint "j" {
    rel physics:body0 = </a>
    rel physics:body1 = </b>
    uniform token physics:axis = "Z"
    %s
}
"""


def stage(folder, *parts, head=""):
    path = folder / "stage.usda"
    path.write_text(f"#usda 1.0\n(metersPerUnit = 1)\n{head}" + "".join(parts))
    return load(path, options=ImportOptions())


def hinge(folder, *lines, head=""):
    spec = stage(folder, BALL % ("a", ""), BALL % ("b", ""), JOINT % "\n".join(lines), head=head)
    world = spec.resolve()
    return spec, next(body.joint for body in world.bodies if body.joint.kind == "hinge")


def lost(spec):
    return [loss.what for loss in spec.source.imported.losses() if loss.severity is LossSeverity.PHYSICS]
