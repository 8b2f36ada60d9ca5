"""Stages of USD: units, mass rules, frames, joints; every attribute accounted for; hostile stages are refused, and no file is
read outside the allowed folders."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.errors import SpecError
from simspec.imports.usd.shapes import CORNERS
from simspec.imports.usd.stage import agree, lines_of
from simspec.language.foreign import Fate, ImportOptions, LossSeverity
from simspec.language.load import load
from simspec.world.kinematics import poses

HEAD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
BODY = 'def Cube "b" (\n    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]\n)\n{\n%s\n}\n'


def stage(folder, text, name="stage.usda", **options):
    path = folder / name
    path.write_text(text)
    return load(path, options=ImportOptions(**options))


RIG = """#usda 1.0
(
    metersPerUnit = 0.01
    kilogramsPerUnit = 0.001
    upAxis = "Y"
)
def PhysicsScene "scene" { }
def Xform "rig"
{
    bool physxArticulation:enabledSelfCollisions = 0
    def Xform "base" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI", "UnknownAPI"]
    )
    {
        float physics:mass = 2000
        float3 physics:diagonalInertia = (1e5, 2e5, 2.5e5)
        point3f physics:centerOfMass = (1, 2, 3)
        float physx:unheard = 3
        double3 xformOp:translate = (0, 100, 0)
        double3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        def Sphere "ball" (
            prepend apiSchemas = ["PhysicsCollisionAPI"]
        )
        {
            double radius = 5
        }
    }
    def Cube "link" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI"]
    )
    {
        double size = 10
        float physics:density = 0.002
        double3 xformOp:translate = (0, 150, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PhysicsRevoluteJoint "hinge" (
        prepend apiSchemas = ["PhysicsDriveAPI:angular"]
    )
    {
        rel physics:body0 = </rig/link>
        rel physics:body1 = </rig/base>
        point3f physics:localPos0 = (0, -10, 0)
        point3f physics:localPos1 = (0, 20, 0)
        uniform token physics:axis = "Z"
        float physics:lowerLimit = -90
        float physics:upperLimit = 45
        float drive:angular:physics:damping = 1000
    }
    def PhysicsFixedJoint "anchor"
    {
        rel physics:body1 = </rig/base>
        point3f physics:localPos0 = (0, 100, 0)
    }
}
"""


def test_units_axes_and_frames(tmp_path):
    spec = stage(tmp_path, RIG)
    world = spec.resolve()
    assert spec.source.imported.data["contact"] == {"self_collision": False}
    bodies = {body.name: body for body in world.bodies}
    placed = poses(world)
    base, link = bodies["base"], bodies["link"]
    assert placed["base"].position == pytest.approx((0, 0, 1))
    assert base.inertial.mass == 2.0
    assert base.inertial.inertia[:3] == pytest.approx((1e-2, 2e-2, 2.5e-2))
    assert base.inertial.centre_of_mass == pytest.approx((0.02, 0.04, 0.06)), "by the body's own factors"
    assert base.shapes[0].size == pytest.approx((0.1,))
    assert link.inertial.mass == pytest.approx(0.002 * 1e-3 * 10**3), "a density of the file's units"
    assert world.physics.gravity == pytest.approx((0, 0, -9.81))
    joint = link.joint
    assert (joint.kind, joint.parent) == ("hinge", "base")
    assert joint.origin.position == pytest.approx((0, 0.4, 0)), "in the base's axes, with its factors"
    assert joint.axis == pytest.approx((0, 0, -1)), "turned around: the file's second body is the parent"
    assert joint.position_limits == pytest.approx((-math.pi / 2, math.pi / 4))
    assert joint.damping == pytest.approx(1000 * 0.001 * 0.01**2 * 180 / math.pi)
    assert placed["link"].position == pytest.approx((0, 0, 1.4)), "the body's frame is at its joint"


def test_everything_is_accounted_for(tmp_path):
    imported = stage(tmp_path, RIG).source.imported
    record = [account.what for account in imported.accounts]
    assert len(record) == len(set(record))
    authored = [line.split("=")[0].split()[-1] for line in RIG.splitlines() if "physics:" in line and "=" in line]
    for name in authored:
        assert any(what.endswith(f"@{name}") for what in record), name
    fates = {account.what: account for account in imported.accounts}
    unheard = fates["/rig/base/@physx:unheard"]
    assert (unheard.fate, unheard.severity) == (Fate.LOST, LossSeverity.PHYSICS)
    assert unheard.location.line == RIG.splitlines().index('    def Xform "base" (') + 1
    assert fates["/rig/base/@apiSchemas:UnknownAPI"].severity is LossSeverity.INFORMATION


CHAIN = (
    HEAD
    + """
def Xform "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
    float physics:mass = 1
    float3 physics:diagonalInertia = (1, 1, 1)
}
def Xform "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
    float physics:mass = 1
    float3 physics:diagonalInertia = (1, 1, 1)
    double3 xformOp:translate = (0.25, 0, 0)
    quatf xformOp:orient = (0.8660254, 0, 0.5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
}
def PhysicsJoint "d6" (prepend apiSchemas = ["PhysicsLimitAPI:transY", "PhysicsLimitAPI:transZ", "PhysicsLimitAPI:rotX"])
{
    rel physics:body0 = </a>
    rel physics:body1 = </b>
    float limit:transY:physics:low = 1
    float limit:transY:physics:high = -1
    float limit:transZ:physics:low = 1
    float limit:transZ:physics:high = -1
    float limit:rotX:physics:low = 1
    float limit:rotX:physics:high = -1
}
def PhysicsSphericalJoint "loop"
{
    rel physics:body0 = </a>
    rel physics:body1 = </b>
    bool physics:excludeFromArticulation = 1
    point3f physics:localPos0 = (0.25, 0, 0)
}
"""
)


def test_a_joint_of_several_axes_is_a_chain_that_stands_where_the_bodies_are(tmp_path):
    spec = stage(tmp_path, CHAIN)
    words = spec.source.imported.data["model"]["bodies"]["b"]["joints"]
    assert [word["name"] for word in words] == ["d6_transX", "d6_rotY", "d6_rotZ"]
    assert words[0]["position"] == pytest.approx(0.25)
    assert words[1]["position"] == pytest.approx(math.pi / 3, abs=1e-6)
    world = spec.resolve()
    place = poses(world)["b"]
    assert place.position == pytest.approx((0.25, 0, 0))
    assert place.quaternion == pytest.approx((math.cos(math.pi / 6), 0, 0.5, 0), abs=1e-6)
    assert world.constraints[0].kind == "connect"


def test_meshes_within_a_stage_are_copied_next_to_a_spec(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    points = "(0,0,0), (1,0,0), (0,1,0), (0,0,1)"
    mesh = 'def Mesh "m" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])\n{\n'
    mesh += f"point3f[] points = [{points}]\nint[] faceVertexCounts = [3, 3, 3, 3]\n"
    mesh += "int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]\n"
    (tmp_path / "m.usda").write_text(HEAD.replace("= 1\n", "= 0.5\n") + mesh + "}\n")
    refused = CliRunner().invoke(cli.app, ["import", "m.usda", "-o", "m.yaml"])
    assert refused.exit_code == 2
    assert not (tmp_path / "m.yaml").exists()
    done = CliRunner().invoke(cli.app, ["import", "m.usda", "-o", "m.yaml", "--meshes", "m-meshes"])
    assert done.exit_code == 0, done.output
    world = load(tmp_path / "m.yaml").resolve()
    assert world.bodies[0].inertial.mass == pytest.approx(1000 * 0.5**3 / 6)
    assert np.abs(world.bodies[0].shapes[0].size).max() < 0.5


SECRET = '#usda 1.0\ndef Xform "S" {}\n'


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('def "a" (references = @../secret.usda@</S>) {}', "leaves the project folder"),
        (
            'def "a" (variants = {string v = "x"}; prepend variantSets = "v")\n{\nvariantSet "v" = {\n"x" {\n}\n'
            '"y" (payload = @link.usda@</S>) {\n}\n}\n}',
            "leaves the project folder",
        ),
        (
            'def "a" (clips = {dictionary d = {asset[] assetPaths = [@../secret.usda@]; string primPath = "/S"; '
            "double2[] active = [(0, 0)]}}) {}",
            "value clips",
        ),
        ('def "a" (references = @`"${A}"`@) {}', "this kind of path"),
    ],
)
def test_no_file_is_read_outside_the_project(tmp_path, text, why):
    project = tmp_path / "project"
    project.mkdir()
    secret = tmp_path / "secret.usda"
    secret.write_text(SECRET)
    os.symlink(secret, project / "link.usda")
    os.utime(secret, (1, 1))
    before = secret.stat().st_atime_ns
    with pytest.raises(SpecError, match=why):
        stage(project, HEAD + text + "\n")
    assert secret.stat().st_atime_ns == before


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (HEAD + BODY % "float physics:mass = nan", r"usda:6:1: /b: physics:mass should be a finite number"),
        (HEAD + BODY % "float physics:mass = ", r"usda:10:\d+: this is no file of USD"),
        (HEAD + 'def Xform "a" {\n' * 20_000 + "}\n" * 20_000, "usd-core gave no answer"),
        (HEAD + 'def "a" (references = @stage.usda@</a>) {}\n', "does not compose"),
        (HEAD + 'def "a" (references = @nowhere.usda@) {}\n', "--repair missing-files"),
        (HEAD.replace("= 1", "= 0") + BODY % "", "units should be above 0"),
        (HEAD + BODY % 'string xformOp:translate = "x"\nuniform token[] xformOpOrder = ["xformOp:translate"]', "/b"),
    ],
)
def test_bad_input_is_refused_with_its_place(tmp_path, text, why):
    with pytest.raises(SpecError, match=why):
        stage(tmp_path, text)


def test_a_truncated_binary_file_is_refused(tmp_path):
    (tmp_path / "a.usda").write_text(HEAD + BODY % "")
    program = (
        f"from pxr import Sdf; Sdf.Layer.FindOrOpen({str(tmp_path / 'a.usda')!r}).Export({str(tmp_path / 'b.usdc')!r})"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    assert load(tmp_path / "b.usdc").resolve().bodies[0].name == "b"
    content = (tmp_path / "b.usdc").read_bytes()
    (tmp_path / "b.usdc").write_bytes(content[: len(content) // 2])
    with pytest.raises(SpecError, match="damaged"):
        load(tmp_path / "b.usdc")
    (tmp_path / "c.usda").write_bytes((HEAD + BODY % "double size = @").encode() + b"\xdb\xdb")
    with pytest.raises(SpecError, match=r"damaged|not UTF-8"):
        load(tmp_path / "c.usda")


def test_lines_of_prims():
    text = b'#usda 1.0\n# def "no"\ndef Xform "a" (\n    doc = """def "no" {"""\n)\n{\n    def "b" {}\n}\n'
    text += b'over "c" { def "b" {} }\n'
    assert lines_of(text) == {"/a": 3, "/a/b": 7, "/c": 9, "/c/b": 9}
    assert lines_of(b"PXR-USDC") == {}


def test_lines_of_long_texts_and_of_deep_texts_take_little_memory():
    """A separate program: its memory is seen for the whole process."""
    program = (
        "import resource; from simspec.imports.usd.stage import lines_of; before = resource.getrusage(resource.RUSAGE_SELF)\n"
        "text = b'#usda 1.0\\n' + b'def \"a\" {\\n' * 50_000 + b'string x = \"' + b'a' * 20_000_000 + b'\"\\n'\n"
        "assert lines_of(text[:20] + text[-20_000_010:]) == {'/a': 2}; assert len(lines_of(text)) < 2000\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before.ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 200_000, "kB"


def test_numbers_agree_where_single_precision_makes_the_difference():
    assert agree((2.1,), (float(np.float32(2.1)),))
    assert not agree((2.1,), (2.10001,))
    assert not agree((0.0,), (1e-30,))


def test_a_spec_that_does_not_resolve_has_its_place_where_drives_ask_for_a_timestep(tmp_path):
    """The timestep at which drives are stable is sought in a world of the data alone, which knows no places."""
    body = 'def Cube "{}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])\n{{\n'
    body += "float physics:mass = 1\n{}\n}}\n"
    hinge = (
        'def PhysicsRevoluteJoint "j" (prepend apiSchemas = ["PhysicsDriveAPI:angular"])\n{\n'
        "rel physics:body0 = </a>\nrel physics:body1 = </b>\nfloat drive:angular:physics:stiffness = 10\n}\n"
    )
    inertia = "float3 physics:diagonalInertia = (1, 1, 1)\n"
    far = 'double3 xformOp:translate = (1e150, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    text = HEAD + body.format("a", inertia + far) + body.format("b", inertia + far) + hinge
    with pytest.raises(SpecError) as error:
        stage(tmp_path, text)
    assert all(problem.location is not None for problem in error.value.problems), str(error.value)
    assert "stage.usda:6:" in str(error.value)


ROUND = BODY.replace("Cube", "{}").replace("{\n%s\n}", "{{\n{}\n}}")
STRETCHED = "double radius = 0.5\ndouble height = 2\ndouble3 xformOp:scale = ({}, {}, {})\n"
STRETCHED += 'uniform token[] xformOpOrder = ["xformOp:scale"]'


def test_round_shapes_are_scaled_along_and_across_their_axis(tmp_path):
    world = stage(tmp_path, HEAD + ROUND.format("Cylinder", STRETCHED.format(0.5, 0.5, 3))).resolve()
    assert (world.bodies[0].shapes[0].kind, world.bodies[0].shapes[0].size) == ("cylinder", pytest.approx((0.25, 6.0)))
    with pytest.raises(SpecError, match="elliptical section"):
        stage(tmp_path, HEAD + ROUND.format("Cylinder", STRETCHED.format(0.5, 0.6, 3)))


def test_a_cone_is_a_closed_mesh_whose_faces_point_outwards(tmp_path, monkeypatch):
    """The volume by the divergence theorem, of a pyramid on a regular polygon: each edge is passed in both directions."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cone.usda").write_text(HEAD + ROUND.format("Cone", STRETCHED.format(1, 1, 1)))
    done = CliRunner().invoke(cli.app, ["import", "cone.usda", "-o", "cone.yaml", "--meshes", "meshes"])
    assert done.exit_code == 0, done.output
    (path,) = (tmp_path / "meshes").rglob("*.obj")
    rows = [line.split() for line in path.read_text().splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    faces = np.array([row[1:] for row in rows if row[0] == "f"], dtype=int) - 1
    edges = [(int(face[k]), int(face[(k + 1) % 3])) for face in faces for k in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    base = 0.5 * CORNERS * 0.5**2 * np.sin(2.0 * np.pi / CORNERS)
    assert np.linalg.det(points[faces]).sum() / 6.0 == pytest.approx(base * 2.0 / 3.0)
