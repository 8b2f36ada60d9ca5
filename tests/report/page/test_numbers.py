"""Numbers of the page, decoded as its program does: motions, forces, ghosts and curves of known values."""

from __future__ import annotations

import base64
import gzip
import json
import re

import numpy as np
import pytest

from simspec.report.page.document import page
from simspec.report.page.playback import driven_bodies, target_poses
from simspec.report.studies import load_study
from simspec.world.rotations import rotation_error
from tests.report.page import samples

TIME = np.arange(21) * 0.1


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    text = page([load_study(samples.stored(samples.a_study(), tmp_path_factory.mktemp("study") / "sample"))])
    blocks = [
        json.loads(re.findall(rf'id="{part}">(.*?)</script>', text, re.DOTALL)[0]) for part in ("scenes", "packed")
    ]
    return blocks[0]["scenes"][0], {
        name: gzip.decompress(base64.b64decode(content)) for name, content in blocks[1].items()
    }


def codes(content: bytes) -> np.ndarray:
    planes = np.frombuffer(content, np.uint8).reshape(2, -1).astype(np.uint16)
    return (planes[0] | planes[1] << 8).astype(np.uint16).view(np.int16)


def series(content: bytes, frames: int) -> np.ndarray:
    return np.cumsum(codes(content).reshape(-1, frames), axis=1, dtype=np.int16).astype(float)


def test_a_body_is_drawn_where_it_was(data):
    scene, packed = data
    low, high = np.array(scene["low"]), np.array(scene["high"])
    for run, speed in zip(scene["runs"], samples.SPEEDS, strict=True):
        values = series(packed[run["motion"]["position"]], 21).reshape(2, 3, 21)[0]
        placed = (values + 32767) / 65534 * (high - low)[:, None] + low[:, None]
        assert placed == pytest.approx(np.array([speed * TIME, 0 * TIME, 0.1 + 0 * TIME]), abs=2e-5)


def test_a_body_is_drawn_as_it_was_turned(data):
    scene, packed = data
    turned = series(packed[scene["runs"][0]["motion"]["turn"]], 21).reshape(4, 21) / 32767
    angle = np.linspace(0.0, 1.0, 21)
    assert turned == pytest.approx(np.array([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle]), abs=5e-5)


def test_forces_are_as_long_as_their_square_roots(data):
    scene, packed = data
    forces = scene["runs"][0]["forces"]
    assert (forces["every"], forces["largest"]) == (1, 100.0)
    assert codes(packed[forces["frame"]]).tolist() == list(range(3, 10))
    expected = np.round(255 * np.sqrt(np.arange(4, 11) / 10))
    assert np.frombuffer(packed[forces["force"]], np.uint8).tolist() == expected.tolist()
    assert np.frombuffer(packed[forces["normal"]], np.int8).reshape(3, 7).tolist() == [[0] * 7, [0] * 7, [127] * 7]


def test_curves_have_the_numbers_of_the_runs(data):
    scene, packed = data
    plots = {
        plot["title"]: [np.frombuffer(packed[line["values"]], "<f4") for line in plot["lines"]]
        for plot in scene["plots"]
    }
    noise, first, _, _, tolerance = plots["Largest difference of any body's position"]
    assert noise.tolist() == pytest.approx([1e-18] * 21)
    assert first == pytest.approx(1e-5 * TIME, abs=1e-9)  # the arm turns alike in all
    assert tolerance.tolist() == pytest.approx([1e-3] * 21)
    # m g h of 2 kg at 0.1 m, twice, and of the arm's centre of mass, which the second turn takes below 0.5 m
    assert plots["Energy of all bodies"][0][0] == pytest.approx(2 * 2 * 10 * 0.1 + 1 * 10 * 0.5)
    assert plots["Contact points"][0].tolist() == [0] * 3 + [1] * 7 + [0] * 11
    assert plots["Sum of the contacts' normal forces"][0].tolist() == [0] * 3 + list(range(40, 110, 10)) + [0] * 11
    assert plots["Largest distance of a driven hinge from its target"][0] == pytest.approx(0.1)


def test_the_ghost_is_where_the_targets_are():
    study = samples.a_study(engines=("first",))
    run, rows = study.runs["first"], np.arange(21)
    assert driven_bodies(study.world, run) == [3]
    ghost = target_poses(study.world, run, rows, [3])
    # the arm lags its target by 0.1 rad about the same point
    assert rotation_error(ghost[:, 3, 3:], run.arrays["pose"][:, 3, 3:]) == pytest.approx(2 * np.sin(0.05))
    assert ghost[:, 3, :3] == pytest.approx(run.arrays["pose"][:, 3, :3])
    assert np.array_equal(ghost[:, :3], run.arrays["pose"][:, :3])
    run.arrays["control.target"][:] -= 0.1
    assert target_poses(study.world, run, rows, [3]) == pytest.approx(run.arrays["pose"])
