"""A fixed few of the files of ``make corpora``: those that an engine's own package brings."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from simspec.audit import FileAudit
from simspec.audit.audit import audit
from simspec.audit.meaning import meaning_of
from simspec.engines.kit.registry import engines
from simspec.language.foreign import ImportOptions

READERS = [name for name, engine in engines().items() if "urdf" in engine.FOREIGN and engine.version() is not None]
FOUND = find_spec("pybullet_data")
pytestmark = pytest.mark.skipif(FOUND is None, reason="pybullet_data is not installed")


def audited(name: str) -> FileAudit:
    assert FOUND is not None
    assert FOUND.submodule_search_locations is not None
    return audit(Path(FOUND.submodule_search_locations[0]) / name, READERS, ImportOptions(), allow_outside=True)


def test_a_finger_is_imported_and_certified():
    found = audited("gripper/wsg50_one_motor_gripper_left_finger.urdf")
    assert not found.defects
    valid = dict.fromkeys(READERS, True)
    assert {compiled.engine: compiled.valid for compiled in found.compiled} == valid
    silent = {engine.engine: {finding.quantity for finding in engine.silent} for engine in found.engines}
    assert "inertia" in silent.pop("pybullet")
    assert silent.pop("mujoco") == {"body"}  # the one link becomes a part of the world: nothing is left that moves
    assert not any(silent.values())


def test_a_robot_with_impossible_inertias_is_refused_by_name():
    found = audited("TwoJointRobot_w_fixedJoints.urdf")
    assert [defect.count("breaks the triangle inequality") for defect in found.defects] == [1, 1]
    assert not found.compiled
    loads = {engine.engine: engine.loaded for engine in found.engines}
    assert loads == {name: name != "mujoco" for name in READERS}


def test_a_defect_that_a_rule_of_sdf_repairs_leaves_a_meaning_to_compare_with():
    """Importers say their rules, and the audit reads a file with all of them; of SDF it once knew none."""
    assert FOUND is not None
    assert FOUND.submodule_search_locations is not None
    meaning = meaning_of(Path(FOUND.submodule_search_locations[0]) / "kuka_iiwa/model.sdf", ImportOptions(), True)
    assert [defect.message for defect in meaning.defects] == ["a link that moves freely has no mass"]
    assert "with every repair" in meaning.source
    assert len(meaning.bodies) == 8
