"""Plain files are loaded by the programs that they are for, each by its plain loader. Their models equal
the world, except for losses of the format and foreseen effects of the reader."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
from pathlib import Path

import pytest

from simspec.audit.audit import loaded
from simspec.audit.exported import (
    FormatReader,
    differences,
    foreseen_differences,
    freedoms,
    reader_losses,
    readers,
)
from simspec.audit.libraries import LIBRARIES
from simspec.audit.meaning import Meaning
from simspec.engines.kit.foreign import CASES, FILE, REFUSED, Effect, Exported, foreseen
from simspec.engines.kit.process import Operation, start
from simspec.engines.kit.registry import engines
from simspec.errors import EngineError
from simspec.formats.kit.contract import formats
from simspec.world.types import Body, Inertial, Joint, World
from tests.files import write
from tests.formats.exported_worlds import LAYOUTS, NAMES, exported_world
from tests.formats.reader_table import RECORD, page

pytestmark = pytest.mark.usefixtures("warm_engines")

LOADED = [(language, profile, reader) for language, profile in LAYOUTS for reader in readers(language)]
NAMED = [f"{language}-{profile or 'only'}-{reader.name}" for language, profile, reader in LOADED]


def installed(reader: FormatReader) -> bool:
    if reader.engine:
        return engines()[reader.name].version() is not None
    return importlib.util.find_spec(LIBRARIES[reader.name].module) is not None


@functools.cache
def plain_of(name, language, profile):
    written = formats()[language]
    return (written.in_profile(profile) if profile else written).plain(exported_world(name))


def parts(name, language, profile):
    """The files of a world, each with what it has."""
    world = exported_world(name)
    files = formats()[language].parts(world, plain_of(name, language, profile).files)
    return {file: Exported(world, bodies, language) for file, bodies in files.items()}


def read(reader, path, language):
    """The read-back of a file by a reader; None where the reader rejects it."""
    if reader.engine:
        loading = loaded(reader.name, Meaning(path, language), None, 60.0)
        if loading.error is not None and not loading.error.refused:
            raise loading.error
        return loading.read_back
    try:
        return LIBRARIES[reader.name].load(path, language)
    except ValueError:
        return None


def read_all(reader, paths, language):
    """The same of several files, of an engine in one process where it refuses none."""
    if reader.engine:
        operations = [Operation("foreign", {"file": str(path), "language": language, "packages": {}}) for path in paths]
        try:
            with start(reader.name, paths[0].parent, operations, deadline=120.0) as running:
                return [answer.read_back for answer in running.wait().answers]
        except EngineError:
            pass  # which of them it refuses, it says of each alone
    return [read(reader, path, language) for path in paths]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of every world in every layout."""
    whole = tmp_path_factory.mktemp("plain")
    for name in NAMES:
        for language, profile in LAYOUTS:
            place = whole / language / (profile or "only") / name
            place.mkdir(parents=True)
            write(plain_of(name, language, profile).files, place)
    return whole


@pytest.mark.parametrize(("language", "profile", "reader"), LOADED, ids=NAMED)
def test_a_reader_has_the_model_of_the_world_except_for_foreseen_differences(language, profile, reader, folder):
    if not installed(reader):
        pytest.skip(f"{reader.name} is not installed")
    rows = [(name, file, part) for name in NAMES for file, part in parts(name, language, profile).items()]
    refused = [
        row for row in rows if REFUSED in {e.quantity for e, _ in foreseen(reader.reads.effects, row[2], profile)}
    ]
    taken = [row for row in rows if row not in refused]
    paths = [folder / language / (profile or "only") / name / file for name, file, _ in taken]
    actual = read_all(reader, paths, language) if paths else []
    singly = [
        read(reader, folder / language / (profile or "only") / name / file, language) for name, file, _ in refused
    ]
    compared = 0
    for (name, file, part), back in zip([*taken, *refused], [*actual, *singly], strict=True):
        losses = plain_of(name, language, profile).losses
        rules = foreseen_differences(reader, part, profile, losses)
        found = {(REFUSED, FILE)} if back is None else differences(reader, part, back, losses)
        assert rules.unlike(found) == (set(), set()), (name, file)
        compared += back is not None
        if back is not None and not {"joint.type", "body"} & {quantity for quantity, _ in found}:
            assert freedoms(back.bodies) == freedoms(part.bodies), (name, file)
    assert compared or len(refused) == len(rows)


@pytest.mark.parametrize(("count", "dies"), [(13, False), (14, True)])
def test_planes_and_many_moving_shapes_end_drake(count, dies, tmp_path):
    """The one reader that dies: the list says so where it happens, and only there."""
    reader = next(reader for reader in readers("sdf") if reader.name == "drake")
    if not installed(reader):
        pytest.skip("drake is not installed")
    world = balls_on_a_plane(count)
    write(formats()["sdf"].plain(world).files, tmp_path)
    foreseen_rows = foreseen(reader.reads.effects, Exported(world, world.bodies, "sdf"), "1.9")
    assert [effect.quantity for effect, _ in foreseen_rows].count(REFUSED) == dies
    loading = loaded(reader.name, Meaning(tmp_path / "world.sdf", "sdf"), None, 60.0)
    assert (loading.error is not None) is dies


def balls_on_a_plane(count):
    scene = exported_world("scene")
    ground, ball = scene.bodies[0], next(body for body in scene.bodies if body.name == "ball")
    balls = tuple(
        dataclasses.replace(
            ball,
            name=f"ball{number}",
            model=f"ball{number}",
            joint=dataclasses.replace(
                ball.joint, name=f"ball{number}_joint", position=(float(number), *ball.joint.position[1:])
            ),
            shapes=tuple(dataclasses.replace(shape, name=f"ball{number}_0") for shape in ball.shapes),
        )
        for number in range(count)
    )
    return dataclasses.replace(scene, bodies=(ground, *balls))


CHANGES = {
    "mass": ('<mass value="0.7"/>', '<mass value="0.8"/>'),
    "joint.axis": ('<axis xyz="1 0 0"/>', '<axis xyz="0 0 1"/>'),
    "joint.origin.xyz": ('xyz="0 0 -0.213"', 'xyz="0 0 -0.214"'),
    "joint.limits": ('upper="3.4"', 'upper="3.3"'),
    "joint.damping": ('damping="0.1"', 'damping="0.2"'),
    "shapes": ('radius="0.022"', 'radius="0.023"'),
}
"""A quantity, and what is changed in the file of the quadruped."""


@pytest.mark.parametrize("quantity", CHANGES)
@pytest.mark.parametrize("name", ["yourdfpy", "pinocchio"])
def test_a_changed_file_is_an_unforeseen_difference(quantity, name, tmp_path):
    """The comparison finds the values that the reader stores."""
    old, new = CHANGES[quantity]
    reader = next(reader for reader in readers("urdf") if reader.name == name)
    plain = plain_of("quadruped", "urdf", "fixed-base")
    assert old in plain.files["trunk.urdf"]
    write({**plain.files, "trunk.urdf": plain.files["trunk.urdf"].replace(old, new)}, tmp_path)
    (part,) = parts("quadruped", "urdf", "fixed-base").values()
    found = differences(reader, part, read(reader, tmp_path / "trunk.urdf", "urdf"), plain.losses)
    unforeseen, missing = foreseen_differences(reader, part, "fixed-base", plain.losses).unlike(found)
    assert quantity in {name for name, _ in unforeseen}
    assert not missing


def test_a_foreseen_difference_that_does_not_occur_is_reported():
    """A row of the rules that no reader confirms fails, as does one that is missing."""
    (part,) = parts("quadruped", "urdf", "fixed-base").values()
    reader = next(reader for reader in readers("urdf") if reader.name == "yourdfpy")
    losses = plain_of("quadruped", "urdf", "fixed-base").losses
    invented = Effect("joint.damping", "dry friction", "halves damping")
    more = dataclasses.replace(
        reader, reads=dataclasses.replace(reader.reads, effects=(*reader.reads.effects, invented))
    )
    found = {("joint.type", "trunk")}
    assert foreseen_differences(reader, part, "fixed-base", losses).unlike(found) == (set(), set())
    unforeseen, missing = foreseen_differences(more, part, "fixed-base", losses).unlike(found)
    assert not unforeseen
    assert ("joint.damping", "hip_FL") in missing
    none = dataclasses.replace(reader, reads=dataclasses.replace(reader.reads, effects=()))
    assert foreseen_differences(none, part, "fixed-base", losses).unlike(found) == (found, set())


def test_every_case_is_used_and_every_rule_has_a_case():
    used = {effect.case for language, _ in LAYOUTS for reader in readers(language) for effect in reader.reads.effects}
    assert used == set(CASES)
    profiles = {(language, profile) for language, profile in LAYOUTS}
    for language, _ in LAYOUTS:
        for reader in readers(language):
            for effect in reader.reads.effects:
                assert all((language, profile) in profiles for profile in effect.profiles), effect


def test_the_rules_need_no_reader():
    """The exporter lists readers that are not installed: it starts nothing."""
    losses = reader_losses(
        exported_world("quadruped"), "urdf", "fixed-base", plain_of("quadruped", "urdf", "fixed-base").files
    )
    assert {loss.reader.name for loss in losses} <= {reader.name for reader in readers("urdf")}
    said = {(loss.reader.name, loss.element): loss.bodies for loss in losses}
    assert said["yourdfpy", "joint.type"] == ("trunk",)
    assert not any(element == "mass" for _, element in said)  # links without mass weigh nothing in any of them


def test_the_record_of_readers_is_current():
    assert Path(RECORD).read_text(encoding="utf-8") == page(), "run: python -m tests.formats.reader_table"


def test_bodies_that_move_with_a_ball_joint_are_those_below_a_root():
    """A root on a ball joint is none of them, but a ball joint below it, and all that it carries."""
    parents = {"a": ("ball", None), "b": ("hinge", "a"), "c": ("ball", "b"), "d": ("slide", "c"), "e": ("hinge", "a")}
    bodies = tuple(Body(name, name, Inertial(1.0), Joint(name, *joint)) for name, joint in parents.items())
    exported = Exported(World("balls", bodies), bodies, "urdf")
    assert list(CASES["body on a ball joint, or on such a body"](exported)) == ["c", "d"]
