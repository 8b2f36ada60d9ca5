"""The page of the engines has all that a class declares, and what committed certificates and studies say, and no more."""

from __future__ import annotations

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
from simspec.report import engine_pages as engine_figures
from simspec.report.matrix import support
from simspec.support.declarations import Level
from simspec.support.features import Feature

ROOT = Path(__file__).parents[2]


def part(page: str, name: str) -> str:
    """What the page says of an engine."""
    title = engines()[name].TITLE or name
    return page.split(f"\n## {title}\n")[1].split("\n## ")[0]


@pytest.fixture(scope="module")
def page() -> str:
    return engine_pages.markdown(ROOT)


@pytest.mark.parametrize("name", engines())
def test_what_a_class_declares_is_there(page, name):
    engine, told = engines()[name], part(page, name)
    [counted] = re.findall(rf"^\| of {len(Feature)} features \| (.*) \|$", told, re.MULTILINE)
    assert sum(map(int, re.findall(r"\b(\d+) ", counted))) == len(Feature)
    for feature, entry in support(engine).items():
        assert (f"- `{feature.value}`: " in told) is (entry.level not in (Level.EXACT, Level.VIA_API))
    assert all(f"| `{setting}` |" in told for setting in engine.SETTINGS)
    if engine.CONTACT_DEVIATIONS:
        rows = told.split("### Known deviations")[1].split("\n### ")[0].splitlines()
        local = sum(one.is_local for one in engine.CONTACT_DEVIATIONS)
        assert len([row for row in rows if row.startswith("|")]) == 2 + len(engine.CONTACT_DEVIATIONS) - local
        assert any(row.startswith(f"{local:,} more count around single values") for row in rows) is (local > 0)


def test_it_does_not_depend_on_what_is_installed(page, monkeypatch):
    for engine in engines().values():
        monkeypatch.setattr(engine, "version", classmethod(lambda cls: None))
    assert engine_pages.markdown(ROOT) == page
    assert engine_pages.is_page(page.encode())
    assert not engine_pages.is_page(b"# Engines\n\nmine\n")


def test_certificates_are_judged_and_counted(tmp_path):
    shutil.copytree(ROOT / "generated" / "ball-pendulum", tmp_path / "generated" / "ball-pendulum")
    shutil.copytree(ROOT / "generated" / "coupled-gripper", tmp_path / "generated" / "coupled-gripper")
    told = part(engine_pages.markdown(tmp_path), "dart")
    assert "1 of 1 certificates are valid, of 2 scenarios of the library." in told
    assert "\n- coupled-gripper: DART does not support constraint.coupling: " in told
    assert "L6 in 1" in told
    assert "L5" not in told.split("### Certificates")[1]
    assert "nearest to what is tolerated" in told
    assert "a step, processor time" not in told


def test_every_scenario_without_a_certificate_is_named_with_the_reason(page):
    library = {path.stem for path in (ROOT / "specs").glob("*.yaml")}
    for name in engines():
        told = part(page, name).split("### Certificates")[1]
        rows = re.findall(r"^- ([a-z0-9, -]+): (.+)$", told, re.MULTILINE)
        lacking = {scenario for scenarios, _ in rows for scenario in scenarios.split(", ")}
        (count,) = re.findall(r"\d+ of (\d+) certificates are valid", told)
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
        engine_pages.markdown(tmp_path)


def test_what_is_measured_is_that_of_certificates_and_study(page):
    study = json.loads((ROOT / engine_figures.STUDY / "study.json").read_text())["sweeps"]["spheres"]
    tables = {table["name"]: table["records"] for table in study}
    [speed] = [row for row in tables["speed.cpu_factor"] if (row["engine"], row["timestep"]) == ("rapier", 0.001)]
    [gap] = [row for row in tables["attribution"] if row["engine"] == "rapier"]
    told = part(page, "rapier").split("### Measured")[1].split("\n### ")[0]
    [row] = [line for line in told.splitlines() if line.startswith("| spheres, 1 ms |")]
    assert f"| {1e3 / speed['median']:.3g} µs | {speed['median']:.3g} | up to 1 ms |" in row
    assert row.endswith(f"| {gap['gap.all']:.2g} m |")
    assert "| spheres, mujoco@3.17, 1 ms |" in part(page, "mujoco")
    assert "| robot" not in told


def test_every_engine_that_can_be_had_has_a_row_of_each_of_its_scenarios(page):
    study = json.loads((ROOT / engine_figures.STUDY / "study.json").read_text())["sweeps"]
    for sweep, tables in study.items():
        records = {table["name"]: table["records"] for table in tables}["speed.cpu_factor"]
        for label in {row["engine"] for row in records}:
            name = label.partition("@")[0]
            rows = [
                line
                for line in part(page, name).splitlines()
                if line.startswith((f"| {sweep}, 1 ms", f"| {sweep}, {label}, 1 ms"))
            ]
            assert rows, (sweep, label)


def test_of_a_level_the_check_that_is_nearest_to_its_tolerance_is_told():
    checks = (
        Check("L1", "mass", 3, 1e-9, 1e-12, "bodies.a.mass"),
        Check("L1", "inertia tensor", 2, 1e-6, 5e-7, "bodies.b.inertia"),
        Check("L2", "poses", 4, 1e-9, 0.0, "a"),
        Check("L4", "shape hull", 1, 0.0, None, "shapes.c"),
        Check("L6", "motion", 0, 1e-9, None, ""),
    )
    certificate = Certificate("one", "0" * 64, "oracle", {"dart": EngineProof("6", "0" * 64, checks)})
    rows = list(engine_figures.closeness("dart", {"one": certificate}))
    assert "| L1 mass | 1 | 5 | inertia tensor, one: 5e-07 of 1e-06 |" in rows
    assert "| L2 kinematics | 1 | 4 | equal |" in rows
    assert any("shape hull, one: different in kind" in row for row in rows)
    assert any("motion, one: nothing was compared" in row for row in rows)
    assert not list(engine_figures.closeness("drake", {"one": certificate}))


def test_without_certificates_and_studies_it_says_nothing_of_them(tmp_path):
    told = engine_pages.markdown(tmp_path)
    assert "### Certificates" not in told
    assert "### Measured" not in told
