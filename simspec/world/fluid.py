"""A fluid around the bodies, and the boxes by which they feel it. Frozen, SI units, all resolved.

The law acts on one box for each body, about its centre of mass, with the edges ``edges`` (a, b, c) along the axes that
``quaternion`` turns: the cuboid of even density that has the body's mass and principal moments of inertia. With v and ω the
velocity of the centre against the fluid and the angular velocity, both in the axes of the box, d the mean of the edges, ρ the
density and μ the viscosity, the force and the torque on it are, along each axis in turn,

    fx = −3 π d μ vx − ½ ρ b c |vx| vx        tx = −π d³ μ ωx − ρ a (b⁴ + c⁴)/64 |ωx| ωx

It is the model of fluids by boxes of equal inertia that one engine brings, to its last constant (``LEAST``; a test holds it
against that engine's own numbers). It is explicit in time: taken at the state before the step.
"""

from __future__ import annotations

from dataclasses import dataclass

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

LEAST = 1e-15
"""kg m²: an edge is √(6 λ/m) with λ the sum of two principal moments less the third, or this where λ is less. It is felt by
bodies of less than a microgram alone."""


@dataclass(frozen=True, slots=True)
class Fluid:
    """Density (kg/m³), viscosity (Pa s), and the velocity of the fluid in world axes (m/s), everywhere the same."""

    density: float = 0.0
    viscosity: float = 0.0
    velocity: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Box:
    """The box of a body: edges (m), and the orientation of its axes in the body's frame. Its centre is the centre of mass that
    engines are told (``world/gathering.py``)."""

    edges: Vector3
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
