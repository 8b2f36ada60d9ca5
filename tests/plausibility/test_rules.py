"""Each rule finds what is planted for it, with its figure and place, and nothing just below its limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from simspec.plausibility.findings import RULES, Grade
from tests.plausibility.files import LANGUAGES, examined, moments, of_rule, urdf

pytestmark = pytest.mark.usefixtures("warm_readers")


def six(values: tuple[float, float, float]) -> str:
    """Principal moments as a text."""
    return " ".join(f"{value:.9g}" for value in values)


SOUND = moments(2.0, 0.06, 0.06, 0.4)
# its centre of mass is in the middle: it reaches 0.03 m along x, more than 5 % of its size
SECOND = 2.25 * 2.0 * 0.03**2
"""The largest second moment along x that is no finding (kg m²)."""


def wide(second: float) -> str:
    """Moments of the arm with this second moment along x; those along y and z are a box's."""
    along_y, along_z = 2.0 * 0.06**2 / 12.0, 2.0 * 0.4**2 / 12.0
    return six((along_y + along_z, second + along_z, second + along_y))


EVERYWHERE = [
    ("mass-outside", "arm", {"centre": "0 0 -0.05"}, {"centre": "0 0 -0.015"}),
    ("inertia-too-large", "arm", {"inertia": wide(1.05 * SECOND)}, {"inertia": wide(0.95 * SECOND)}),
    (
        "inertia-too-small",
        "arm",
        {"inertia": six(tuple(value / 11.0 for value in SOUND))},
        {"inertia": six(tuple(value / 9.0 for value in SOUND))},
    ),
    (
        "density-high",
        "arm",
        {"mass": "33.5", "inertia": six(moments(33.5, 0.06, 0.06, 0.4))},
        {"mass": "32", "inertia": six(moments(32.0, 0.06, 0.06, 0.4))},
    ),
    (
        "density-low",
        "tip",
        {"tip_mass": "0.005", "tip_inertia": six(moments(0.005, 0.05, 0.05, 0.3))},
        {"tip_mass": "0.016", "tip_inertia": six(moments(0.016, 0.05, 0.05, 0.3))},
    ),
    (
        "mass-tiny",
        "tip",
        {"tip_mass": "0.00009", "tip_inertia": six(moments(0.00009, 0.05, 0.05, 0.3))},
        {"tip_mass": "0.00011", "tip_inertia": six(moments(0.00011, 0.05, 0.05, 0.3))},
    ),
    (
        "mass-ratio",
        "arm and tip",
        {"tip_mass": "0.0019", "tip_inertia": six(moments(0.0019, 0.05, 0.05, 0.3))},
        {"tip_mass": "0.0021", "tip_inertia": six(moments(0.0021, 0.05, 0.05, 0.3))},
    ),
    ("size", "tip", {"tip_box": "0.05 0.05 10.1"}, {"tip_box": "0.05 0.05 9.9"}),
    ("size", "base", {"tip_origin": "0 0 20"}, {"tip_origin": "0 0 19"}),
    # the model spans 0.2 + 0.705 m and more with the gap; 5 % of it is more than the 2 cm
    ("detached", "tip", {"tip_origin": "0 0 0.46"}, {"tip_origin": "0 0 0.44"}),
    ("axis-apart", "elbow", {"tip_place": "0.12 0 0.15"}, {"tip_place": "0.09 0 0.15"}),
    ("overlap-neighbours", "arm and tip", {"tip_origin": "0 0 0.39"}, {"tip_origin": "0 0 0.396"}),
    ("limits-equal", "elbow", {"tip_lower": "0", "tip_upper": "0"}, {"tip_lower": "-0.1", "tip_upper": "0"}),
    ("limits-narrow", "elbow", {"tip_lower": "0", "tip_upper": "0.069"}, {"tip_lower": "0", "tip_upper": "0.071"}),
    ("limits-wide", "elbow", {"tip_lower": "-90", "tip_upper": "45"}, {"tip_lower": "-6.28", "tip_upper": "6.28"}),
    ("limits-wide", "elbow", {"tip_lower": "-7", "tip_upper": "7"}, {"tip_lower": "-62.8319", "tip_upper": "62.8319"}),
]
"""Rule, element, a slip, and nearly the same slip that is none; in every language."""


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(("rule", "element", "slip", "sound"), EVERYWHERE)
def test_planted(tmp_path, language, rule, element, slip, sound):
    if (language, rule) == ("xml", "limits-equal"):
        pytest.skip("in that language equal limits are none")
    found = of_rule(examined(LANGUAGES[language](**slip), language, tmp_path), rule)
    assert [finding.element for finding in found] == [element]
    assert found[0].location is not None
    assert found[0].location.file.endswith(f"model.{language}")
    assert found[0].severity >= 1.0
    assert not of_rule(examined(LANGUAGES[language](**sound), language, tmp_path), rule)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_sound_model_has_no_findings(tmp_path, language):
    found = examined(LANGUAGES[language](), language, tmp_path)
    assert found.findings == ()
    assert found.sampling.positions == found.sampling.planned > 100


VISUAL = '<visual><origin xyz="{}"/><geometry><box size="{}"/></geometry></visual>'
OF_FILES = [
    ("shapes-apart", Grade.WARNING, {"visual": VISUAL.format("0.3 0 0.2", "0.06 0.06 0.4")}),
    ("shapes-apart", Grade.NOTE, {"visual": VISUAL.format("0 0 0.2", "0.02 0.02 0.12")}),
    (
        "shape-twice",
        Grade.WARNING,
        {"visual": VISUAL.format("0 0 0.2", "0.06 0.06 0.4").replace("visual", "collision")},
    ),
    ("axis-length", Grade.NOTE, {"axis": "0 2 0"}),
    ("rating-zero", Grade.WARNING, {"effort": "0"}),
    ("rating-zero", Grade.WARNING, {"velocity": "0"}),
]


@pytest.mark.parametrize(("rule", "grade", "slip"), OF_FILES)
def test_planted_in_robot_files(tmp_path, rule, grade, slip):
    found = of_rule(examined(urdf(**slip), "urdf", tmp_path), rule)
    assert [finding.grade for finding in found] == [grade]
    assert found[0].location is not None


def test_shapes_that_nearly_agree(tmp_path):
    text = VISUAL.format("0.02 0 0.22", "0.07 0.07 0.42")
    assert not of_rule(examined(urdf(visual=text), "urdf", tmp_path), "shapes-apart")
    assert not of_rule(examined(urdf(axis="0 1.0005 0"), "urdf", tmp_path), "axis-length")


def test_links_that_nothing_can_touch(tmp_path):
    found = examined(urdf(collision=""), "urdf", tmp_path)
    assert {finding.element for finding in of_rule(found, "no-collision")} == {"arm", "tip"}
    # the base is a root that moves freely, and it has a collision shape
    assert {finding.grade for finding in of_rule(found, "no-collision")} == {Grade.NOTE}
    text = urdf(collision="").replace("<collision>", "<visual>").replace("</collision>", "</visual>")
    everywhere = of_rule(examined(text, "urdf", tmp_path), "no-collision")
    assert {finding.grade for finding in everywhere} == {Grade.WARNING}


def test_a_sketch_is_judged_by_what_can_be_touched(tmp_path):
    text = LANGUAGES["yaml"](centre="0 0 -0.05").replace("{box", "{collision: false, box")
    assert not of_rule(examined(text, "yaml", tmp_path), "mass-outside")


@pytest.mark.parametrize(("language", "grade"), [("urdf", Grade.WARNING), ("yaml", Grade.NOTE)])
def test_a_mismatch_is_a_mistake_in_a_robot_file(tmp_path, language, grade):
    found = of_rule(examined(LANGUAGES[language](centre="0 0 -0.05"), language, tmp_path), "mass-outside")
    assert [finding.grade for finding in found] == [grade]
    assert found[0].value == pytest.approx(0.05, rel=1e-3)


def test_meshes(tmp_path):
    """An open one, and two of one name in different folders."""
    tetrahedron = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    for folder, content in (("a", tetrahedron), ("b", tetrahedron.rpartition("f ")[0])):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "part.obj").write_text(content, encoding="utf-8")
    mesh = '<collision><geometry><mesh filename="{}/part.obj"/></geometry></collision>'
    found = examined(urdf(visual=mesh.format("a") + mesh.format("b")), "urdf", tmp_path)
    assert [finding.element for finding in of_rule(found, "mesh-names")] == ["part.obj"]
    assert [finding.location is not None for finding in of_rule(found, "mesh-surface")] == [True]
    plausibility = examined(urdf(visual=mesh.format("a")), "urdf", tmp_path)
    assert not of_rule(plausibility, "mesh-names")
    assert not of_rule(plausibility, "mesh-surface")


def test_an_inside_out_and_a_hollow_mesh(tmp_path):
    # an L-shaped prism: two thirds of its hull and less
    outline = [(0, 0), (3, 0), (3, 0.5), (0.5, 0.5), (0.5, 3), (0, 3)]
    count = len(outline)
    lines = [f"v {0.1 * x} {0.1 * y} {z}" for z in (0, 0.1) for x, y in outline]
    caps = [(1, 2, 3), (1, 3, 4), (1, 4, 6), (4, 5, 6)]
    faces = [(a, c, b) for a, b, c in caps] + [(a + count, b + count, c + count) for a, b, c in caps]
    for index in range(count):
        a, b = index + 1, (index + 1) % count + 1
        faces += [(a, b, b + count), (a, b + count, a + count)]
    (tmp_path / "hollow.obj").write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces)]) + "\n")
    (tmp_path / "turned.obj").write_text("\n".join([*lines, *(f"f {a} {c} {b}" for a, b, c in faces)]) + "\n")
    mesh = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
    hollow = examined(urdf(visual=mesh.format("hollow.obj")), "urdf", tmp_path)
    # the outline has an area of 2.75, its hull one of 6.25 - 2.5 ** 2 / 2 + ...: 9 - 3.125
    assert [finding.value for finding in of_rule(hollow, "mesh-concave")] == [pytest.approx(5.875 / 2.75, rel=1e-6)]
    turned = examined(urdf(visual=mesh.format("turned.obj")), "urdf", tmp_path)
    assert [finding.grade for finding in of_rule(turned, "mesh-surface")] == [Grade.WARNING]


def test_overlap_at_the_start(tmp_path):
    # a tip so long that it reaches back into the base, two joints away
    found = of_rule(examined(urdf(tip_box="0.05 0.05 0.9", tip_place="0 0 -0.2"), "urdf", tmp_path), "overlap-start")
    assert {finding.element for finding in found} == {"base and tip"}
    assert found[0].value == pytest.approx(0.125, rel=0.05)  # out of the base's side: 0.1 + 0.025


def test_a_slide_whose_axis_is_turned(tmp_path):
    """A drawer that its slide drives through the cabinet, or out of it."""
    box = {"box": "0.18 0.18 0.05", "place": "0 0 0.03", "centre": "0 0 0.03", "type": "prismatic", "lower": "0"}
    box["inertia"] = six(moments(2.0, 0.18, 0.18, 0.05))
    inwards = examined(urdf(**box, axis="0 0 -1", upper="0.15"), "urdf", tmp_path)
    assert [finding.element for finding in of_rule(inwards, "pass-through")] == ["base and arm"]
    assert not of_rule(examined(urdf(**box, axis="0 0 1", upper="0.15"), "urdf", tmp_path), "pass-through")


def test_every_rule_is_tried():
    text = Path(__file__).read_text(encoding="utf-8") + Path(__file__).with_name("test_sweep.py").read_text(
        encoding="utf-8"
    )
    assert [code for code in RULES if f'"{code}"' not in text] == []


def test_the_page_has_every_rule():
    page = (Path(__file__).resolve().parents[2] / "docs" / "guide" / "audit.md").read_text(encoding="utf-8")
    for rule in RULES.values():
        assert f"| `{rule.code}` | {rule.limit} | {rule.why} | {rule.hint} |" in page


def test_rules_are_whole_sentences_with_a_way_out():
    for code, rule in RULES.items():
        assert rule.code == code
        assert all(len(text) > 10 for text in (rule.limit, rule.why, rule.hint)), code
