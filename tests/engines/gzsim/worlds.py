"""Worlds for gz sim: an arm on a base, next to a free body that carries another, and a pendulum."""

from __future__ import annotations

import yaml

from simspec import Spec
from simspec.world.types import World

ARMS = """
simspec: 1
name: arms
bodies:
  base:
    fixed: true
    pose: {xyz: [0.3, -0.2, 1], rpy: [0.2, 0.1, -0.4]}
  upper:
    parent: base
    mass: 2 kg
    centre_of_mass: [0.1, 0.02, -0.3]
    inertia: {tensor: {xx: 0.2, yy: 0.21, zz: 0.05, xy: 0.01, xz: -0.02, yz: 0.005}}
    joint: {type: hinge, axis: [0.6, 0.8, 0], origin: {xyz: [0.1, 0, 0], rpy: [0, 0.3, 0]}, damping: 0.2, position: 0.4,
            velocity: -1}
  ram:
    parent: upper
    mass: 1 kg
    inertia: {principal: [0.02, 0.03, 0.04]}
    joint: {type: slide, axis: [0, 0, 1], origin: {xyz: [0, 0.1, -0.5]}, spring: {stiffness: 30, rest: 0.05}, velocity: 0.3}
  plane:
    pose: {xyz: [1, 2, 3], rpy: [0.5, -0.2, 0.3]}
    mass: 3 kg
    centre_of_mass: [0.05, 0, 0.02]
    inertia: {tensor: {xx: 0.2, yy: 0.3, zz: 0.4, xy: 0.02}}
    velocity: {linear: [1, 0.5, 2], angular: [1, -2, 0.5]}
  rudder:
    parent: plane
    mass: 0.5 kg
    inertia: {principal: [0.02, 0.03, 0.04]}
    joint: {type: hinge, axis: [0, 0, 1], origin: {xyz: [-0.6, 0, 0.1]}, position: -0.3, velocity: 2}
engines: {gzsim: {accept: [joint.free]}}
"""
PENDULUM = """
simspec: 1
name: pendulum
physics: {timestep: 1 ms, duration: 0.1 s}
bodies:
  base: {fixed: true}
  bob:
    parent: base
    mass: 1 kg
    centre_of_mass: [0, 0, -0.5]
    inertia: {principal: [0.1, 0.1, 0.05]}
    joint: {type: hinge, axis: [0, 1, 0], position: 0.4}
"""


def world_of(text: str) -> World:
    return Spec.from_data(yaml.safe_load(text)).resolve()
