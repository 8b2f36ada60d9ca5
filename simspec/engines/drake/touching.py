"""What Drake says of the contacts of the last step: points of two geometries, and surfaces of hydroelastic contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.engines.drake.simulation import Simulation
from simspec.engines.kit.arrays import empty_contacts

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Touch:
    """One contact of the geometries ``ids`` (A, B): its position (m), the normal from B to A, the force on A along it (N), and
    the depth (m)."""

    ids: tuple[Any, Any]
    position: Vector
    normal: Vector
    force: float
    depth: float


def contacts(sim: Simulation) -> dict[str, np.ndarray]:
    """The contacts that the last step used, as arrays with ``CONTACT_FIELDS``."""
    results = sim.last_contacts()
    if results is None:
        return empty_contacts()
    touches = [_point(results.point_pair_contact_info(index)) for index in range(results.num_point_pair_contacts())]
    touches += [
        _surface(results.hydroelastic_contact_info(index)) for index in range(results.num_hydroelastic_contacts())
    ]
    if not touches:
        return empty_contacts()
    units = np.array([[sim.shape_of[side] for side in one.ids] for one in touches], dtype=np.int64)
    bodies = np.array([body for body, _ in sim.built.shapes], dtype=np.int64)
    return {
        "body": bodies[units],
        "unit": units,
        "position": np.array([one.position for one in touches]),
        "normal": np.array([one.normal for one in touches]),
        "distance": -np.array([one.depth for one in touches]),
        "normal_force": np.maximum([one.force for one in touches], 0.0),
    }


def _point(told: Any) -> Touch:
    pair = told.point_pair()
    on_first = -float(np.sum(pair.nhat_BA_W * told.contact_force()))  # Drake's is on the second
    return Touch((pair.id_A, pair.id_B), told.contact_point(), pair.nhat_BA_W, on_first, float(pair.depth))


def _surface(told: Any) -> Touch:
    """A contact surface as one contact, where its pressure acts together. Its normal is that of its faces, by their area."""
    surface = told.contact_surface()
    faces = range(surface.num_faces())
    normal = np.sum([surface.area(face) * surface.face_normal(face) for face in faces], axis=0)
    normal /= np.linalg.norm(normal)
    wrench = told.F_Ac_W()  # on the body of M, about the centroid
    force, torque = wrench.translational(), wrench.rotational()
    along = float(normal @ force)
    centre = np.cross(normal, torque) / along if along > 0.0 else np.zeros(3)
    return Touch((surface.id_M(), surface.id_N()), surface.centroid() + centre, normal, along, _depth(surface))


def _depth(surface: Any) -> float:
    """How deep two shapes are in each other (m): pressure grows with depth, in a box by the same everywhere."""
    pressure = surface.poly_e_MN()
    largest = max(float(pressure.EvaluateAtVertex(vertex)) for vertex in range(surface.num_vertices()))
    slopes = [surface.EvaluateGradE_M_W(0)] if surface.HasGradE_M() else []
    slopes += [surface.EvaluateGradE_N_W(0)] if surface.HasGradE_N() else []
    return sum(largest / float(np.linalg.norm(slope)) for slope in slopes)
