"""The order in which the sidecar lists classes of the collision filter is no part of the model."""

from __future__ import annotations

import json

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.kit.session import Session
from simspec.proof.selftest_worlds import meshes

pytest.importorskip("pybullet")


def test_motion_with_contact_is_the_same_to_the_last_bit(tmp_path):
    files = compile_world(meshes("pybullet"), ["pybullet"])["pybullet"].files
    content = json.loads(files[SIDECAR])
    classes = content["collision_filter"]["classes"]
    assert len(classes) > 1
    classes.reverse()
    ends = []
    for name, text in (("as written", files[SIDECAR]), ("reversed", json.dumps(content))):
        write_folder({**files, SIDECAR: text}, tmp_path / name)
        with Session("pybullet", tmp_path / name) as session:
            session.step(600)
            ends.append(np.concatenate([part.ravel() for part in session.body_states()]))
    assert ends[0].tobytes() == ends[1].tobytes()
