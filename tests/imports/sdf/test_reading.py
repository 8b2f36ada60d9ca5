"""SDF as specs: Drake's parser, which shares nothing with the importer, finds the same places, masses and mass matrix."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.language.load import load
from simspec.world import frames
from simspec.world.kinematics import layout_of, rigid_groups
from tests.imports.sdf.made import Maker

VERSIONS = ("1.2", "1.3", "1.4", "1.5", "1.6", "1.7", "1.8", "1.9", "1.10", "1.11")
SEEDS = range(4)
TOLERANCE = 1e-9


def theirs(requests, folder):
    path = folder / "requests.json"
    path.write_text(json.dumps(requests))
    script = Path(__file__).with_name("drake_reader.py")
    done = subprocess.run([sys.executable, str(script), str(path)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def flat(name):
    """A name of the other reader, as the spec has it."""
    return name.partition("::")[2].replace("::", "_")


def assert_same(world, positions, read):
    """Every body of the other reader is in the world, with its mass, place and inertia; the mass matrix is the same."""
    oracle, layout = Oracle(world), layout_of(world)
    q, columns = np.zeros(layout.nq), {}
    for body, place, velocity in zip(world.bodies, layout.position, layout.velocity, strict=True):
        q[place] = body.joint.position
        if body.joint.kind in ("hinge", "slide"):
            q[place] = positions.get(body.joint.name, 0.0)
            columns[body.joint.name] = velocity.start
    bodies = {flat(name): value for name, value in read["bodies"].items()}
    assert bodies.keys() == {body.name for body in world.bodies}
    for body, pose in zip(world.bodies, oracle.body_poses(q), strict=True):
        turn = np.array(frames.matrix(tuple(pose[3:])))
        xx, yy, zz, xy, xz, yz = body.inertial.inertia
        inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        other = bodies[body.name]
        if not body.inertial.mass:
            static = rigid_groups(world)[body.name] == "world"
            assert static, "the default of a missing inertial is left out where nothing moves"
            continue
        assert body.inertial.mass == pytest.approx(other["mass"], rel=TOLERANCE)
        centre = pose[:3] + turn @ np.array(body.inertial.centre_of_mass)
        np.testing.assert_allclose(centre, other["centre"], atol=TOLERANCE)
        np.testing.assert_allclose(inertia, other["inertia"], atol=TOLERANCE)
    assert {flat(name) for name in read["order"]} == columns.keys()
    order = [columns[flat(name)] for name in read["order"]]
    mass = oracle.mass_matrix(q)[np.ix_(order, order)]
    np.testing.assert_allclose(mass, np.array(read["mass"]).reshape(mass.shape), atol=TOLERANCE)


def test_another_reader_finds_the_same_model_in_files_of_every_version(tmp_path):
    requests, worlds = [], []
    for version in VERSIONS:
        for seed in SEEDS:
            maker = Maker(seed, version)
            path = tmp_path / f"{version}-{seed}.sdf"
            path.write_text(maker.file())
            world = load(path).resolve()
            draw = random.Random(seed)
            positions = {
                body.joint.name: draw.uniform(-1, 1) for body in world.bodies if body.joint.kind in ("hinge", "slide")
            }
            local = {name.removeprefix("inner_") if "inner_inner" in name else name: q for name, q in positions.items()}
            requests.append({"file": str(path), "positions": local})
            worlds.append((world, positions))
    moving = 0
    for (world, positions), read in zip(worlds, theirs(requests, tmp_path), strict=True):
        assert_same(world, positions, read)
        moving += len(positions)
    assert moving > 3 * len(worlds) / 2
