"""The page of the engines has all that a class declares, and what committed certificates and studies say, and no more."""

from __future__ import annotations

import gzip
import json
import re
import shutil
from pathlib import Path

import pytest

from simspec.engines.kit.registry import engines
from simspec.errors import SpecError
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.report import engine_pages
from simspec.report.matrix import support
from simspec.support.declarations import Level
from simspec.support.features import Feature

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    """Pages by the name of the engine."""
    return by_engine(ROOT)


def by_engine(root: Path) -> dict[str, str]:
    return {Path(name).stem: page for name, page in engine_pages.pages(root).items()}


@pytest.mark.parametrize("name", engines())
def test_declarations_of_the_engine_class_are_on_its_page(pages, name):
    engine, page = engines()[name], pages[name]
    [counted] = re.findall(rf"^\| of {len(Feature)} features \| (.*) \|$", page, re.MULTILINE)
    assert sum(map(int, re.findall(r"\b(\d+) ", counted))) == len(Feature)
    listed = {
        name for line in page.splitlines() if line.startswith("- `") for name in line.split(": ")[0][2:].split(", ")
    }
    for feature, entry in support(engine).items():
        assert (f"`{feature.value}`" in listed) is (entry.level not in (Level.EXACT, Level.VIA_API))
    assert all(f"| `{setting}` |" in page for setting in engine.SETTINGS)
    if engine.CONTACT_DEVIATIONS:
        section = page.split("## Known deviations")[1].split("\n## ")[0]
        counts = re.findall(r"^\| [\w-]+ \| .* \| ([\d,]+) \|$", section, re.MULTILINE)
        assert sum(int(count.replace(",", "")) for count in counts) == len(engine.CONTACT_DEVIATIONS)


def test_each_reason_stands_once_on_a_page(pages):
    for page in pages.values():
        reasons = [line.partition(": ")[2] for line in page.splitlines() if line.startswith("- `")]
        reasons += re.findall(r"^\*\*.*\*\*$", page, re.MULTILINE)
        assert len(reasons) == len(set(reasons))


def test_it_does_not_depend_on_what_is_installed(pages, monkeypatch):
    for engine in engines().values():
        monkeypatch.setattr(engine, "version", classmethod(lambda cls: None))
    assert by_engine(ROOT) == pages
    assert all(engine_pages.is_page(page.encode()) for page in pages.values())
    assert not engine_pages.is_page(b"# Engines\n\nmine\n")


def test_engines_whose_files_alone_are_proven_are_listed_separately(pages):
    running, files_only = pages["engines"].split("\n## Files only\n")
    for name, engine in engines().items():
        assert f"](engines/{name}.md)" in (files_only if engine.FILES_ALONE else running)


def test_certificates_are_judged_and_counted(tmp_path):
    shutil.copytree(ROOT / "generated" / "ball-pendulum", tmp_path / "generated" / "ball-pendulum")
    shutil.copytree(ROOT / "generated" / "coupled-gripper", tmp_path / "generated" / "coupled-gripper")
    page = by_engine(tmp_path)["dart"]
    assert "1 of 1 certificates are valid, of 2 scenarios of the library." in page
    assert "\n- coupled-gripper: DART supports constraint.coupling only approximately: " in page
    assert "L6 in 1" in page
    assert "L5" not in page.split("## Certificates")[1]
    assert "nearest to what is tolerated" in page
    assert "a step, processor time" not in page


def test_every_scenario_without_a_certificate_is_named_with_the_reason(pages):
    library = {path.stem for path in (ROOT / "specs").glob("*.yaml")}
    for name in engines():
        part = pages[name].split("## Certificates")[1]
        rows = re.findall(r"^- ([a-z0-9, -]+): (.+)$", part, re.MULTILINE)
        lacking = {scenario for scenarios, _ in rows for scenario in scenarios.split(", ")}
        (count,) = re.findall(r"\d+ of (\d+) certificates are valid", part)
        assert len(lacking) == len(library) - int(count)
        assert lacking <= library
        allowed = ["does not support", "only approximately"]
        allowed += ["a proof of files only"] if engines()[name].FILES_ALONE else []
        assert all(any(words in why for words in allowed) for _, why in rows)


def test_a_damaged_certificate_is_an_error(tmp_path):
    shutil.copytree(ROOT / "generated" / "ball-pendulum", tmp_path / "generated" / "ball-pendulum")
    file = tmp_path / "generated" / "ball-pendulum" / "certificate.json"
    file.write_text(file.read_text().replace('"worst": 0.0', '"worst": 1.0', 1))
    with pytest.raises(SpecError, match=r"certificate\.json"):
        engine_pages.pages(tmp_path)


def test_measured_figures_come_from_certificates_and_the_study(pages):
    study = json.loads(gzip.decompress((ROOT / engine_pages.STUDY / "study.json.gz").read_bytes()))["sweeps"]["spheres"]
    tables = {table["name"]: table["records"] for table in study}
    [speed] = [row for row in tables["speed.cpu_factor"] if (row["engine"], row["timestep"]) == ("rapier", 0.001)]
    [gap] = [row for row in tables["attribution"] if row["engine"] == "rapier"]
    part = pages["rapier"].split("## Measured")[1].split("\n## ")[0]
    [row] = [line for line in part.splitlines() if line.startswith("| spheres, 1 ms |")]
    assert f"| {1e3 / speed['median']:.3g} µs | {speed['median']:.3g} | up to 1 ms |" in row
    assert row.endswith(f"| {gap['gap.all']:.2g} m |")
    assert "| spheres, mujoco@3.17, 1 ms |" in pages["mujoco"]
    assert "| robot, 1 ms |" in part
    assert "| spheres" not in pages["mjx"]  # which takes too many contacts there


def test_every_engine_that_can_be_had_has_a_row_of_each_of_its_scenarios(pages):
    study = json.loads(gzip.decompress((ROOT / engine_pages.STUDY / "study.json.gz").read_bytes()))["sweeps"]
    for sweep, tables in study.items():
        records = {table["name"]: table["records"] for table in tables}["speed.cpu_factor"]
        for label in {row["engine"] for row in records}:
            name = label.partition("@")[0]
            rows = [
                line
                for line in pages[name].splitlines()
                if line.startswith((f"| {sweep}, 1 ms", f"| {sweep}, {label}, 1 ms"))
            ]
            assert rows, (sweep, label)


def test_each_level_names_the_check_nearest_to_its_tolerance():
    checks = (
        Check("L1", "mass", 3, 1e-9, 1e-12, "bodies.a.mass"),
        Check("L1", "inertia tensor", 2, 1e-6, 5e-7, "bodies.b.inertia"),
        Check("L2", "poses", 4, 1e-9, 0.0, "a"),
        Check("L4", "shape hull", 1, 0.0, None, "shapes.c"),
        Check("L6", "motion", 0, 1e-9, None, ""),
    )
    certificate = Certificate("one", "0" * 64, "oracle", {"dart": EngineProof("6", "0" * 64, checks)})
    rows = list(engine_pages.closeness("dart", {"one": certificate}))
    assert "| L1 mass | 1 | 5 | inertia tensor, one: 5e-07 of 1e-06 |" in rows
    assert "| L2 kinematics | 1 | 4 | equal |" in rows
    assert any("shape hull, one: different in kind" in row for row in rows)
    assert any("motion, one: nothing was compared" in row for row in rows)
    assert not list(engine_pages.closeness("drake", {"one": certificate}))


def test_without_certificates_and_studies_it_says_nothing_of_them(tmp_path):
    text = "\n".join(engine_pages.pages(tmp_path).values())
    assert "## Certificates" not in text
    assert "## Measured" not in text
