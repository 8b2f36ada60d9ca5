"""Output about the contact law: tables of figures, the plot by direction, and how each engine realises the law."""

from __future__ import annotations

import dataclasses
import io
import math

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import find_engine
from simspec.errors import SpecError
from simspec.proof.contact.probe import ProbeFigure, project
from simspec.report import figures as polar
from simspec.report.certificate import contact_table, deviations
from simspec.report.console import Screen
from simspec.report.explain import explained, tables, ways
from simspec.support.features import Feature
from simspec.world.types import Hardness
from tests import worlds
from tests.declared import engines_with

ENGINES = engines_with(Feature.RESTITUTION)

FRICTION = 0.4


def push(cone: str = "elliptic", scale: float = 1.0, subject: str = "rubber, steel") -> ProbeFigure:
    """A push figure of an engine whose friction is ``scale`` times what the cone requires."""
    points = []
    for number in range(24):
        angle = math.radians(15 * number)
        force = scale * project([1.6 * FRICTION * math.cos(angle), 1.6 * FRICTION * math.sin(angle)], FRICTION, cone)
        points.append((angle, float(force[0]), float(force[1])))
    size = math.hypot(*points[3][1:]) / scale
    numbers = (size, scale * size, 0.01 * size)
    where = {"worst": "45°", "angle": math.radians(45.0)}
    return ProbeFigure(polar.PROBE, subject, "24 directions", "friction", "", *numbers, points=tuple(points), **where)


def printed(*shown: object) -> str:
    screen = Screen(width=120, record=True, file=io.StringIO())
    for part in shown:
        screen.print(part)
    return screen.export_text()


def test_a_table_puts_engines_side_by_side():
    rest = ProbeFigure("rest", "rubber, steel", "cube put down", "depth", "m", 0.0, 2e-5, 1e-4)
    nothing = dataclasses.replace(rest, measured=None)
    declared = dataclasses.replace(push(scale=1.05), tolerance=0.1, deviation="it hops")
    figures = {"one": [push(), rest], "other": [push(scale=0.9), nothing], "third": [declared]}
    text = printed(*contact_table(figures))
    assert "0.4" in text
    assert "0.36 (-10 %) FAILED" in text
    assert "0.42 (+5 %)" in text
    assert "known deviation" in text
    assert "no value" in text
    assert "2e-05 m" in text
    assert deviations(figures) == ["third, push-oblong: it hops"]


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-inscribed", "pyramid-circumscribed"])
def test_the_plot_is_the_same_bytes_every_time(cone):
    figures = {"one": [push(cone), push(cone, subject="steel, steel")], "other": [push(cone, 0.95)]}
    files = polar.polar_plot(figures, cone)
    assert list(files) == [".svg", ".png"]
    assert files[".png"].startswith(b"\x89PNG")
    again = polar.polar_plot(figures, cone)
    assert files[".svg"] == again[".svg"]
    other = polar.polar_plot({**figures, "other": [push(cone, 0.9)]}, cone)
    assert files[".svg"] != other[".svg"]


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-inscribed", "pyramid-circumscribed"])
def test_the_plot_finds_the_friction_that_was_required(cone):
    assert polar._friction(push(cone, 0.7), cone) == pytest.approx(FRICTION, rel=1e-12)


def test_a_force_of_the_right_size_and_the_wrong_direction_is_drawn_as_wrong(monkeypatch):
    """On the circle all points look right: a stroke leads from where each should be."""
    from matplotlib.axes import Axes

    strokes = []
    real = Axes.plot

    def plot(self, x, y, **more):
        if len(x) == 2:
            strokes.append((x, y))
        return real(self, x, y, **more)

    given = []
    monkeypatch.setattr(Axes, "text", lambda self, x, y, text, **more: given.append(text))
    monkeypatch.setattr(Axes, "plot", plot)
    polar.polar_plot({"one": [push()]}, "elliptic")
    assert (strokes, given) == ([], [""])
    turn = complex(math.cos(0.3), math.sin(0.3))
    turned = [(angle, (complex(x, y) * turn).real, (complex(x, y) * turn).imag) for angle, x, y in push().points]
    polar.polar_plot({"one": [dataclasses.replace(push(), points=tuple(turned))]}, "elliptic")
    assert len(strokes) == 24
    assert given[1] == "one: 30 % of μ deviation"  # 2 sin(0.15)
    for (x, y), point, wrong in zip(strokes, push().points, turned, strict=True):
        assert (x[0], y[0]) == pytest.approx(point[1:])
        assert (x[1], y[1]) == pytest.approx(wrong[1:])


def test_the_legend_names_engines_that_the_first_panel_lacks(monkeypatch):
    from matplotlib.figure import Figure as Chart

    named = []
    real = Chart.legend

    def legend(self, handles, labels, **more):
        named.extend(labels)
        return real(self, handles, labels, **more)

    monkeypatch.setattr(Chart, "legend", legend)
    figure, other = push(), push(subject="steel, steel")
    polar.polar_plot({"first": [figure, other], "late": [other]}, "elliptic")
    assert named == ["required: elliptic (circle)", "first", "late"]


def test_nothing_is_drawn_where_nothing_has_friction():
    smooth = dataclasses.replace(push(), expected=0.0, measured=0.0)
    assert polar.polar_plot({"one": [smooth]}, "elliptic") == {}


def test_without_matplotlib_the_way_out_is_named(monkeypatch):
    import builtins

    real = builtins.__import__

    def absent(name, *more, **named):
        if name == "matplotlib":
            raise ImportError("No module named 'matplotlib'")
        return real(name, *more, **named)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(SpecError, match=r"simspec-physics\[plots\]"):
        polar.polar_plot({"one": [push()]}, "elliptic")


TABLE = {("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4}
"""No rule of combination gives it."""


def compiled(world, engine):
    return compile_world(world, [engine])[engine]


def listed(artifacts, folder):
    """The explicit pairs of shapes in an engine's files, by the format's own reader."""
    write_folder(artifacts.files, folder)
    return dialects()[artifacts.dialect].read(folder).pairs


@pytest.mark.parametrize("engine", ENGINES)
def test_it_is_explained_how_each_pair_is_had(engine, tmp_path):
    world = worlds.table(TABLE)
    files = compiled(world, engine)
    explanation = explained(world, files)
    assert {(pair.first, pair.second): pair.law["friction"] for pair in explanation.pairs} == TABLE
    found = ways(explanation)
    if find_engine(engine).RULES.friction == "table":
        assert (found["explicit"], found["layered"]) == (0, 0)
        return
    assert found["explicit"] or found["layered"]
    assert bool(explanation.copies) == bool(found["layered"])
    assert (
        explanation.explicit
        == sum(pair.explicit for pair in explanation.pairs)
        == len(listed(files, tmp_path / engine))
    )
    text = printed(*tables(world, files))
    assert "a, b" in text
    if found["layered"]:
        assert "layer 1 of 2" in text
        assert f"realised by copies: {explanation.copies} additional" in text
    else:
        assert "not representable by material parameters" in text
        assert f"{explanation.explicit} explicit pairs of shapes in all" in text


@pytest.mark.parametrize("engine", ENGINES)
def test_a_law_that_material_numbers_give_is_explained_by_them(engine, tmp_path):
    """Some files also list pairs of shapes, for parameters that only a pair has: the explanation says so, with their count."""
    world = worlds.shapes_world(("sphere", "box"))
    files = compiled(world, engine)
    explanation = explained(world, files)
    assert ways(explanation) == {"numbers": 1}
    assert explanation.copies == 0
    count = len(listed(files, tmp_path / engine))
    assert explanation.pairs[0].explicit == count
    assert ("which override the material parameters" in explanation.pairs[0].how) == bool(count)


def test_some_engine_lists_pairs_that_numbers_give_too():
    world = worlds.shapes_world(("sphere", "box"))
    assert any(explained(world, compiled(world, engine)).explicit for engine in ENGINES)


def test_settings_of_the_spec_are_marked_and_settings_of_the_compiler_are_listed():
    world = worlds.with_options(worlds.shapes_world(("sphere",)), "pybullet", settings=(("iterations", 77),))
    settings = {setting.name: setting for setting in explained(world, compiled(world, "pybullet")).settings}
    assert (settings["iterations"].value, settings["iterations"].given) == (77, True)
    assert (settings["contact_slop"].value, settings["contact_slop"].given) == (0.0, False)
    settings = {setting.name: setting for setting in explained(world, compiled(world, "dart")).settings}
    assert settings["collision_detector"].value == "auto"
    assert settings["collision_detector"].in_force != "auto"


def test_a_law_is_explained_with_units_and_with_pairs_that_do_not_touch():
    world = worlds.table(TABLE)
    spring = Hardness("stiffness", stiffness=1e6, damping=500.0)
    new = {
        ("a", "a"): {"hardness": spring, "rolling_friction": 0.002},
        ("a", "b"): {"collide": False, "friction": 0.0},
    }
    pairs = tuple(dataclasses.replace(pair, **new.get((pair.first, pair.second), {})) for pair in world.contact.pairs)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    explanation = explained(world, compiled(world, "pybullet"))
    assert [(pair.first, pair.second) for pair in explanation.pairs] == [("a", "a"), ("a", "b"), ("b", "b")]
    assert ways(explanation)["passing"] == 1
    text = " ".join(printed(*tables(world, compiled(world, "pybullet"))).split())
    assert "no collision" in text
    assert explanation.pairs[0].law["hardness"] == {"stiffness": 1e6, "damping": 500.0}
    assert "rolling friction 0.002 m" in text
