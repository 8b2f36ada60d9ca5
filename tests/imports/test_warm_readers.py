"""A reader that is forked from a warm process is as confined as a new process, and its answers are the same."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from simspec.confinement import walls
from simspec.imports import child
from simspec.imports.child import ChildError, Policy
from simspec.meshes.reading import MeshFile, read_surfaces
from tests.meshes.solids import box, stl
from tests.readers import LIBRARIES, WarmReaders, patched

pytest.importorskip("trimesh")

PROGRAM = """
import json, os, resource, sys
def prepare():
    resource.setrlimit(resource.RLIMIT_CPU, (1, 2))
def main():
    request = json.loads(sys.stdin.buffer.read())
    while request["do"] == "end":
        pass
    try:
        answer = open(request["path"]).read()
    except OSError as error:
        answer = type(error).__name__
    print(json.dumps([answer, os.getcwd() != request["here"], sorted(os.environ)]), end="")
"""


@pytest.fixture
def warm(monkeypatch):
    with WarmReaders() as readers:
        patched(monkeypatch, readers)
        yield readers


def test_a_mesh_is_the_same(warm):
    files = [MeshFile(Path("m.stl"), stl(*box(0.1, 0.2, 0.3))), MeshFile(Path("m.stl"), b"damaged")]
    forked = read_surfaces(files)
    assert warm._servers, "a new process was started"
    warm.Popen = subprocess.Popen
    new = read_surfaces(files)
    np.testing.assert_array_equal(forked[0].vertices, new[0].vertices)
    assert str(forked[1]) == str(new[1]) != ""


@pytest.mark.skipif(not walls().landlock, reason="this kernel has no Landlock")
def test_it_is_confined_and_its_end_is_seen(warm, tmp_path):
    program = tmp_path / next(name for name in LIBRARIES if name == "model_compiler.py")
    program.write_text(PROGRAM)
    secret = tmp_path.parent / "secret"
    secret.write_text("secret")

    def answer(what="open"):
        request = json.dumps({"do": what, "path": str(secret), "here": os.getcwd()}).encode()
        return child.run(program, [], request, 60.0, Policy("files"))

    forked = json.loads(answer())
    assert forked[0] == "PermissionError"
    with pytest.raises(ChildError, match="more time"):
        answer("end")
    warm.Popen = subprocess.Popen
    assert json.loads(answer()) == forked
