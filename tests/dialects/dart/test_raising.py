"""The meaning of a .skel to DART: content that simspec does not write is rejected with file and line."""

from __future__ import annotations

import json
import re

import pytest

from simspec.compiler import compile_world
from simspec.dialects.dart.dialect import DartDialect
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.formats.skel.format import WORLD
from simspec.proof.selftest_worlds import WORLDS
from tests.files import write


@pytest.fixture(scope="module")
def files():
    return dict(compile_world(WORLDS["model"]("dart"), ["dart"])["dart"].files)


def _read(folder, files):
    return DartDialect().read(write(files, folder))


@pytest.mark.parametrize(
    ("what", "by", "said"),
    [
        ("<physics>", "<physics><sub_steps>4</sub_steps>", r"world\.skel:\d+: <sub_steps>: is not known here"),
        ("<time_step>0.001</time_step>", "", "has no <time_step>"),
        ('type="revolute"', 'type="screw"', "the type 'screw' is not known here"),
        ("<parent>base</parent>", "<parent>unknown</parent>", "the parent 'unknown' is missing"),
        ("<parent>base</parent>", "<parent>lower</parent>", "go round in a circle"),
        ("<damping>0</damping>", "<damping>1</damping>", "DART's own, implicit, damping"),
        ("<gravity>true</gravity>", "<gravity>false</gravity>", "should have the <gravity> true"),
        ("<transformation>0 0 0 0 0 0</transformation>\n        <parent>", "<parent>", "is not at its child's frame"),
        ("<sphere><radius>", "<sphere><size>1</size><radius>", "<size>: is not known here in <sphere>"),
    ],
)
def test_content_that_simspec_does_not_write_is_rejected(files, tmp_path, what, by, said):
    assert what in files[WORLD]
    with pytest.raises(ValueError, match=said):
        _read(tmp_path, {**files, WORLD: files[WORLD].replace(what, by, 1)})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content["bodies"].pop(), "sidecar.models has"),
        (lambda content: content["enforce_limits"].clear(), "are not both given and enforced"),
        (lambda content: content["shapes"].pop(), "have shapes that the sidecar does not name"),
        (lambda content: content.update(damping=[{"body": "unknown", "value": 1.0}]), "'unknown', which is not known"),
        (lambda content: content["springs"][0].update(rest="0"), "springs.0.rest is '0', should be a finite number"),
    ],
)
def test_a_sidecar_that_does_not_fit_is_refused(files, tmp_path, change, said):
    content = json.loads(files[SIDECAR])
    change(content)
    with pytest.raises(ValueError, match=re.escape(said)):
        _read(tmp_path, {**files, SIDECAR: json.dumps(content)})
