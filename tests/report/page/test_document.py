"""The page as text: one file that loads nothing, says the same for the same runs, and in which names are text."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import hashlib
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest

from simspec.errors import SpecError, visible
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.report.page.document import MOST_STUDIES, page
from simspec.report.page.packing import PackedNumbers
from simspec.report.page.shapes import drawn_field, drawn_shapes
from simspec.report.studies import StoredStudy, load_study
from simspec.world import shapes
from simspec.world.canonical import sha256
from simspec.world.hull import mesh_size, mesh_triangles
from simspec.world.types import Shape
from tests.report.page import samples


class Outline(HTMLParser):
    """The elements of a page with their attributes, and their text."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self._open = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._open = tag

    def handle_data(self, data):
        self.texts.append((self._open, data))

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    return page([load_study(samples.stored(samples.a_study(), tmp_path_factory.mktemp("study") / "sample"))])


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    study = samples.a_study(samples.a_world(samples.HOSTILE_BODIES, samples.HOSTILE[5]))
    return page([load_study(samples.stored(study, tmp_path_factory.mktemp("study") / "hostile"))])


def test_the_policy_allows_only_the_program_and_style_of_the_page(usual):
    outline = Outline(usual)
    (policy,) = [
        attributes["content"]
        for attributes in outline.of("meta")
        if attributes.get("http-equiv") == "Content-Security-Policy"
    ]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert set(rules) == {"default-src", "script-src", "style-src", "base-uri", "form-action"}
    for element, rule in (("script", "script-src"), ("style", "style-src")):
        inside = re.findall(rf"<{element}>(.*?)</{element}>", usual, re.DOTALL)
        assert len(inside) == 1
        digest = base64.b64encode(hashlib.sha256(inside[0].encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"


def test_it_names_nothing_to_load(usual):
    outline = Outline(usual)
    assert {tag for tag, _ in outline.elements} <= {
        *(
            "html",
            "head",
            "meta",
            "title",
            "style",
            "body",
            "header",
            "main",
            "section",
            "footer",
            "noscript",
            "script",
        ),
        *("h1", "h2", "h3", "p", "ul", "li", "span", "div", "details", "summary", "pre"),
        *("table", "caption", "thead", "tbody", "tr", "th", "td"),
    }
    assert not any({"src", "href", "style", "action", "data"} & set(attributes) for _, attributes in outline.elements)
    assert not any(name.startswith("on") for _, attributes in outline.elements for name in attributes)


def test_the_same_runs_give_the_same_page(tmp_path):
    folder = samples.stored(samples.a_study(), tmp_path / "sample")
    assert page([load_study(folder)]) == page([load_study(folder)])


def test_verdict_tables_and_certificate_are_there_without_a_program(usual):
    outline = Outline(usual)
    captions = [text.strip() for tag, text in outline.texts if tag == "caption" and text.strip()]
    for title in ("Results", "Expectations", "Repeatability", "Differences between engines", "Final state", "Model"):
        assert any(caption.startswith(title) for caption in captions), title
    order = [usual.index(part) for part in ('class="verdict"', 'class="stage"', "<caption>Results", "<caption>Model")]
    assert order == sorted(order)


def test_licences_of_the_libraries_are_in_the_page(usual):
    texts = [text for tag, text in Outline(usual).texts if tag == "pre"]
    assert sum("Permission is hereby granted, free of charge" in text for text in texts) == 2


@pytest.mark.parametrize("name", samples.HOSTILE_BODIES[1:])
def test_markup_in_names_is_text(usual, hostile, name):
    found, plain = Outline(hostile), Outline(usual)
    tags = [tag for tag, _ in found.elements]
    assert sorted(tags) == sorted(tag for tag, _ in plain.elements)
    assert not any(attribute.startswith("on") for _, attributes in found.elements for attribute in attributes)
    assert any(visible(name) in text for tag, text in found.texts if tag == "td")
    assert [sorted(attributes) for attributes in found.of("section")] == [["aria-label", "id"]]
    assert found.of("section")[0]["aria-label"] == samples.HOSTILE[5]


def test_no_name_ends_the_data(hostile):
    for part in ("scenes", "packed"):
        (data,) = re.findall(rf'<script type="application/json" id="{part}">(.*?)</script>', hostile, re.DOTALL)
        assert not set("<>&\u2028\u2029") & set(data)
        loaded = json.loads(data)
        assert loaded
    scenes = json.loads(re.findall(r'id="scenes">(.*?)</script>', hostile, re.DOTALL)[0])["scenes"]
    assert scenes[0]["bodies"] == list(map(visible, samples.HOSTILE_BODIES))
    assert scenes[0]["name"] == visible(samples.HOSTILE[5])


def scene(text: str) -> dict:
    return json.loads(re.findall(r'id="scenes">(.*?)</script>', text, re.DOTALL)[0])["scenes"][0]


def test_moving_and_fixed_bodies_are_distinguished(usual):
    found = scene(usual)
    assert (found["bodies"], found["moving"], found["turning"]) == (["floor", "resting", "mover", "arm"], [2, 3], [3])
    assert [shape["kind"] for shape in found["shapes"]] == ["plane", "box", "sphere", "capsule"]
    assert found["ghost"]["bodies"] == [3]
    assert [run["forces"]["count"] for run in found["runs"]] == [7, 7, 7]
    titles = [plot["title"] for plot in found["plots"]]
    assert len(titles) == 5
    assert titles[0] == "Largest difference of any body's position"
    assert [line["kind"] for line in found["plots"][0]["lines"]] == ["band", "line", "line", "line", "limit"]


def test_a_run_that_stopped_being_finite_is_shown_until_then(tmp_path):
    study = samples.a_study(engines=("first", "second"))
    study.runs["second"].arrays["pose"][12:, 2, 0] = np.nan
    folder = samples.stored(study, tmp_path / "sample")
    text = page([load_study(folder)])
    assert [run["frames"] for run in scene(text)["runs"]] == [21, 12]
    assert "second stays where its records end, at 1.1 s." in text
    assert "NaN" not in json.dumps(scene(text))


def test_a_body_that_is_thrown_away_does_not_blur_the_others(tmp_path):
    study = samples.a_study(engines=("first", "second"))
    study.runs["second"].arrays["pose"][15:, 2, 0] = 1e6
    text = page([load_study(samples.stored(study, tmp_path / "sample"))])
    found = scene(text)
    assert (
        max(high - low for low, high in zip(found["low"], found["high"], strict=True)) / 65534
        < 0.003 * found["view"]["radius"]
    )
    assert "Bodies that leave the scene are drawn at its edge." in text


def test_a_single_run_has_a_page(tmp_path):
    folder = samples.stored(samples.a_study(), tmp_path / "sample")
    text = page([load_study(folder / "first")])
    assert "The model was not checked" in text
    assert len(scene(text)["runs"]) == 1


def test_too_many_studies_are_refused(tmp_path):
    study = load_study(samples.stored(samples.a_study(engines=("first",)), tmp_path / "sample"))
    with pytest.raises(SpecError, match="1 to 6 studies"):
        page([study] * (MOST_STUDIES + 1))


def emptied(study):
    """Runs of one record."""
    for name, run in study.runs.items():
        arrays = {key: values[:1] for key, values in run.arrays.items() if not key.startswith("contact.")}
        study.runs[name] = dataclasses.replace(run, arrays=arrays)


def lost(study):
    """Nothing that could be drawn, from the first record on."""
    for run in study.runs.values():
        run.arrays["pose"][:] = np.nan


def thrown(study):
    """Beyond all that single precision has."""
    study.runs["second"].arrays["pose"][3:, 2, 0] = 1e300
    study.runs["second"].arrays["velocity"][3:, 2] = 1e300


def endless_shapes(study):
    body = dataclasses.replace(study.world.bodies[2], shapes=(Shape("huge", "sphere", (1e308,)),))
    bodies = (*study.world.bodies[:2], body, study.world.bodies[3])
    of = dataclasses.replace(study.world, bodies=bodies)
    for name, run in study.runs.items():
        study.runs[name] = dataclasses.replace(run, world=of, provenance={**run.provenance, "world_sha256": sha256(of)})


def torn(study):
    """Forces and energies that are not finite."""
    study.runs["first"].arrays["contact.normal_force"][:] = [np.nan, np.inf, 0.0, 1.0, 2.0, 3.0, -1.0]
    study.runs["first"].arrays["velocity"][:] = np.nan


@pytest.mark.parametrize("spoil", [emptied, lost, thrown, endless_shapes, torn], ids=lambda spoil: spoil.__name__)
def test_a_page_is_made_of_runs_that_went_wrong(tmp_path, spoil):
    study = samples.a_study(engines=("first", "second"), proven=False)
    spoil(study)
    for run in study.runs.values():
        run.save(tmp_path / run.engine)
    with np.errstate(all="ignore"):
        found = scene(page([load_study(tmp_path)]))
    numbers = [*found["low"], *found["high"], *found["view"]["centre"], found["view"]["radius"]]
    assert all(np.isfinite(number) for number in numbers)
    assert all(low < high for low, high in zip(found["low"], found["high"], strict=True))
    assert [run["frames"] for run in found["runs"]] == {
        "emptied": [1, 1], "lost": [1, 1], "thrown": [21, 3], "endless_shapes": [21, 21], "torn": [21, 21]
    }[spoil.__name__]  # fmt: skip


def test_two_runs_in_the_same_engine_are_not_mixed(tmp_path):
    folder = samples.stored(samples.a_study(engines=("first", "second")), tmp_path / "sample")
    shutil.copytree(folder / "second", folder / "second-again")
    with pytest.raises(SpecError, match="two runs in second"):
        load_study(folder)


def test_markup_in_any_text_of_runs_and_certificates_is_text(tmp_path):
    """Names and versions of engines, reasons of failures, settings, checks, approximations: all texts that a user can edit."""
    bad = "</td></script><script>x</script><img src=x onerror=x>\" onfocus='x'"
    study = samples.a_study(engines=("first", "second"))
    facts = dict.fromkeys(
        ("engine_version", "simspec", "python_version", "platform", "started", "artifacts_sha256"), bad
    )
    for name, run in list(study.runs.items()):
        engine = f"{name} <script>"
        provenance = {**run.provenance, **facts, "engine": engine, "settings": {bad: bad}, "warnings": [bad]}
        study.runs[name] = dataclasses.replace(run, engine=engine, provenance=provenance, failed=bad)
    check = Check(bad, bad, 4, 1e-9, 1.0, bad, bad)
    proof = EngineProof(bad, bad, (check,), {bad: f"approximate: {bad}"}, {bad: bad}, 0.0, (), {bad: bad})
    certificate = Certificate(bad, sha256(study.world), bad, {bad: proof, "first <script>": proof})
    read = StoredStudy(dataclasses.replace(study, certificate=certificate, floors={}), tmp_path, (bad,))
    outline = Outline(page([read]))
    assert len(outline.of("script")) == 3
    assert not outline.of("img")
    assert not any(name.startswith("on") for _, attributes in outline.elements for name in attributes)
    assert sum(bad in text for tag, text in outline.texts if tag in ("td", "th", "p", "li", "span")) > 10


def test_hulls_of_meshes_are_packed_once_with_their_faces():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) - 0.25
    world = samples.a_world()
    mesh, other = mesh_size(vertices), mesh_size(2.0 * vertices)
    bodies = tuple(
        dataclasses.replace(body, shapes=(Shape("hull", "mesh", size), Shape("ball", "sphere", (0.1,))))
        for body, size in zip(world.bodies[:3], (mesh, mesh, other), strict=True)
    )
    packed = PackedNumbers()
    shown = drawn_shapes(dataclasses.replace(world, bodies=bodies), packed, {})
    hulls = [shape["hull"] for shape in shown if shape["kind"] == "mesh"]
    assert hulls[0] == hulls[1] != hulls[2]
    assert len(packed.entries) == 4
    assert all("hull" not in shape for shape in shown if shape["kind"] != "mesh")

    def unpacked(name):
        return gzip.decompress(base64.b64decode(packed.entries[name]))

    np.testing.assert_allclose(np.frombuffer(unpacked(hulls[2]["vertices"]), "<f4").reshape(-1, 3), 2.0 * vertices)
    low, high = np.frombuffer(unpacked(hulls[0]["triangles"]), np.uint8).reshape(2, -1).astype(int)
    assert (low + 256 * high).reshape(-1, 3).tolist() == mesh_triangles(mesh).tolist()


def test_height_fields_are_drawn_as_triangles_and_large_fields_with_fewer():
    generator = np.random.default_rng(2)
    small = shapes.heightfield_size(2.0, 1.0, 0.5, generator.uniform(0.0, 0.3, (4, 5)))
    large = shapes.heightfield_size(2.0, 1.0, 0.5, generator.uniform(0.0, 0.3, (300, 500)))
    points, triangles = drawn_field(small)
    assert len(triangles) == len(shapes.field_of(small).closed()[1])
    points, triangles = drawn_field(large)
    assert triangles.max() == len(points) - 1 < 2**16
    assert np.ptp(points[:, :2], axis=0).tolist() == [2.0, 1.0]
    assert points[:, 2].min() == -0.5
