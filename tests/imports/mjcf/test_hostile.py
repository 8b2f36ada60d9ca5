"""Untrusted MJCF files: a clear error, nothing read that is not allowed, bounded time and memory."""

from __future__ import annotations

import pytest

from simspec.cli import main
from simspec.errors import SpecError
from simspec.imports.mjcf import contact
from simspec.imports.mjcf.bodies import MjcfNames
from simspec.language.foreign import ImportOptions
from tests.imports.mjcf.models import read, written

BODY = '<body><freejoint/><geom size="1"/></body>'


def model(inside: str, around: str = "") -> str:
    return f"<mujoco>{around}<worldbody>{inside}</worldbody></mujoco>"


def nested(count: int, depth: int) -> str:
    return f'<replicate count="{count}" offset="1 0 0">' * depth + BODY + "</replicate>" * depth


HOSTILE = {
    "nested replicate": (model(nested(100, 5)), "too many elements"),
    "composite": (model('<body><composite type="cable" count="100000 100000 1"/></body>'), "too many elements"),
    "long counts": (model('<replicate count="' + "9" * 4000 + '">' + BODY + "</replicate>"), "too many elements"),
    "many long counts": (
        model(f'<body><composite count="{" ".join(["9" * 4000] * 500)}"/></body>'),
        "too many elements",
    ),
    "count": (model('<replicate count="1e300">' + BODY + "</replicate>"), "whole number"),
    "depth": (model("<body>" * 220 + "</body>" * 220), "within each other"),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c">]>' + model(BODY), "DOCTYPE"),
    "nan": (model('<body pos="nan 0 0"><freejoint/><geom size="1"/></body>'), "refuses it"),
    "infinite": (model('<body pos="inf 0 0"><freejoint/><geom size="1"/></body>'), "."),
    "many bodies": (model('<replicate count="8001">' + BODY + "</replicate>"), "too many bodies, replicates counted"),
    "a cable": (model('<body><composite type="cable" count="8001 1 1"/></body>'), "too many bodies"),
    "empty": (model(""), "no bodies"),
    "other root": ("<robot/>", "begins with"),
    "unknown": (model("<bodyy/>"), "refuses it"),
    "itself": (model(BODY, '<include file="model.xml"/>'), "included already"),
    "outside": (model(BODY, '<include file="../../secret.xml"/>'), "leaves the project folder"),
    "absolute": (model(BODY, '<include file="/etc/passwd"/>'), "leaves the project folder"),
    "mesh outside": (model(BODY, '<asset><mesh file="../secret.stl"/></asset>'), "leaves the project folder"),
    "mesh folder": (
        model(BODY, '<compiler meshdir="/etc"/><asset><mesh file="passwd"/></asset>'),
        "leaves the project folder",
    ),
    "asset folder": (
        model(BODY, '<compiler assetdir="../.."/><asset><hfield name="h" size="1 1 1 1" file="secret.png"/></asset>'),
        "leaves the project folder",
    ),
    "attached outside": (model(BODY, '<asset><model file="../secret.xml"/></asset>'), "leaves the project folder"),
    "attaches itself": (model(BODY, '<asset><model file="model.xml"/></asset>'), "attaches itself"),
    "no such mesh": (model(BODY, '<asset><mesh file="missing.stl"/></asset>'), "no such file"),
    "height field": (
        model(BODY, '<asset><hfield name="h" size="1 1 1 1" nrow="100000" ncol="100000"/></asset>'),
        "too large a height field",
    ),
    "deformable": (model('<flexcomp name="f" type="grid" count="9 9 9"/>'), "deformable"),
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_files_are_refused(tmp_path, text, message):
    (tmp_path / "secret.xml").write_text("<x/>")
    (tmp_path / "secret.stl").write_bytes(b"x" * 100)
    project = tmp_path / "project"
    path = written(project, text)
    with pytest.raises(SpecError, match=message) as caught:
        read(path, ImportOptions(project=project))
    assert all(problem.location is not None for problem in caught.value.problems)


@pytest.mark.parametrize("content", [b"\0" * 100, b"<mujoco", b"\xff\xfe<mujoco>", b"<mujoco/>" * 3, b"", b"<mujoco/>"])
def test_damaged_files_are_refused(tmp_path, content):
    path = tmp_path / "model.xml"
    path.write_bytes(content)
    with pytest.raises(SpecError):
        read(path)


def test_a_link_does_not_lead_out(tmp_path):
    (tmp_path / "secret.stl").write_bytes(b"x")
    project = tmp_path / "project"
    path = written(project, model(BODY, '<asset><mesh file="in.stl"/></asset>'))
    (project / "in.stl").symlink_to(tmp_path / "secret.stl")
    with pytest.raises(SpecError, match="leaves the project folder"):
        read(path, ImportOptions(project=project))


def test_a_thousand_free_bodies_are_read(tmp_path):
    """The engine's own guess of the memory that one state of them takes is above what its process may have."""
    imported = read(written(tmp_path, model(f'<replicate count="1200" offset="3 0 0">{BODY}</replicate>')))
    assert len(imported.data["bodies"]) == 1200


def test_the_command_ends_with_2(tmp_path, capsys):
    assert main(["check", str(written(tmp_path, model(nested(100, 5))))]) == 2
    assert "too many elements" in capsys.readouterr().err


def test_a_size_that_is_no_number_when_it_is_doubled_is_refused_at_its_place(tmp_path, capsys):
    text = model(
        '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>\n<geom type="box" size="1 1 1e308"/></body>'
    )
    assert main(["check", str(written(tmp_path, text))]) == 2
    assert (
        "model.xml:2:1: error[S203]: model.bodies.body_1.shapes.0.box.size.2: not a usable number"
        in capsys.readouterr().err
    )


def test_a_long_chain_of_includes_is_refused(tmp_path):
    for number in range(300):
        (tmp_path / f"a{number}.xml").write_text(f'<mujoco><include file="a{number + 1}.xml"/></mujoco>')
    with pytest.raises(SpecError, match=r"a199\.xml:1:1: .* more than 200 files that include each other in a chain"):
        read(written(tmp_path, model(BODY, '<include file="a0.xml"/>')))


def test_too_many_different_surfaces_are_refused(tmp_path, monkeypatch):
    """Geoms that nothing touches do not count: they are not compared with others."""
    monkeypatch.setattr(contact, "MOST_SURFACES", 5)
    geom = '<geom size="1" friction="{} 1 1" contype="{}" conaffinity="0"/>'
    bare = "".join(geom.format(number, 0) for number in range(20))
    assert read(written(tmp_path, model(f"<body><freejoint/>{bare}</body>")))
    felt = "".join(geom.format(number, 1) for number in range(6))
    with pytest.raises(SpecError, match="too many different surfaces of contact"):
        read(written(tmp_path, model(f"<body><freejoint/>{felt}</body>")))


def test_many_equal_names_are_given_in_few_steps(monkeypatch):
    """Each of 20,000 names that are the same to the language compares two names, not all that were given before it."""

    class Counting(set):
        compared = 0

        def __contains__(self, name):
            Counting.compared += 1
            return super().__contains__(name)

    names = MjcfNames(Counting())
    given = {names.give("n" * 200 + str(number), "") for number in range(20_000)}
    assert len(given) == 20_000
    assert Counting.compared < 50_000
