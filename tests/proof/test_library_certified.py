"""Every shipped spec is certified in every installed engine that claims it: a few in two engines here, all by ``make certify``,
nightly."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import simspec
from simspec.engines.kit.registry import engines
from simspec.proof.judge import judge
from simspec.proof.verify import verify
from simspec.selection import supporting
from tests.caches import cache_home
from tests.nightly import BOTH

pytestmark = pytest.mark.usefixtures("warm_engines")

ROOT = Path(__file__).resolve().parent.parent.parent / "specs"
ALL = "SIMSPEC_CERTIFY"
"""Where this variable is ``all``, every spec is certified."""
SHIPPED = sorted(path for folder in ("", "contact", "motion") for path in (ROOT / folder).glob("*.yaml"))
QUICK = ("compliance-laws", "conveyor", "rolling-laws", "rough-ground")
"""Those of which two engines take some seconds of processor time each, with laws that no other test measures."""


def test_no_folder_of_specs_is_left_out():
    """Models are parts of specs, studies are sweeps of them."""
    folders = {path.parent for path in ROOT.rglob("*.yaml")} - {ROOT / "models", ROOT / "studies"}
    assert folders == {path.parent for path in SHIPPED}
    assert set(QUICK) <= {path.stem for path in SHIPPED}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_it_is_certified_in_every_engine_that_claims_it(path, tmp_path, monkeypatch):
    whole = os.environ.get(ALL) == "all"
    if path.stem not in QUICK and not whole:
        pytest.skip("certified by make certify")
    monkeypatch.setenv("XDG_CACHE_HOME", cache_home(tmp_path))
    spec = simspec.load(path)
    world = spec.resolve()
    here = [
        name for name, engine in sorted(engines().items()) if engine.version() is not None and (whole or name in BOTH)
    ]
    found = verify(world, list(supporting(world, here, spec.locate)[0]), locate=spec.locate)
    assert [f"{name}: {check.level} {check.name}: {check.detail}" for name, check in found.failures()] == []
    assert judge(found, world) == []
