"""States of a world in Webots: the file that begins in one, and the coordinates that follow from where its Solids are.

A Supervisor cannot put a BallJoint into a place, and a joint that it moves by less than some limit stays (the sources of
R2023b): so each state is told as a file is, by the fields that say how Solids stand and move at the beginning.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from simspec.dialects.webots.nodes import turn
from simspec.dialects.webots.places import centres, moved, twists
from simspec.dialects.webots.raising import raised, solids_of
from simspec.dialects.webots.sidecar import WebotsSidecar
from simspec.formats.wbt.document import Document, Node, Value
from simspec.formats.wbt.rewriting import text_of
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.gathering import told_inertial
from simspec.world.kinematics import initial_state, layout_of, poses, rigid_groups
from simspec.world.tuples import quaternion, vector3
from simspec.world.types import Body, Pose, Vector3, World


class States:
    """What a document and its sidecar say of coordinates. Poses and velocities are those of the world's body frames.

    Raises ValueError, which names the place, where the two do not fit together or hold what simspec does not write.
    """

    def __init__(self, document: Document, told: WebotsSidecar):
        self.document = document
        self.held = raised(document, told)
        self.world = World("", self.held.bodies)
        self.turned = solids_of(document)[0]
        bodies = self.world.bodies
        self.layout = layout_of(self.world)
        rows = {body.name: row for row, body in enumerate(bodies)}
        self.parents = [-1 if body.joint.parent is None else rows[body.joint.parent] for body in bodies]
        self._offsets = [Pose(body.frame_offset) for body in told.bodies]
        self.levers = [
            told_inertial(self.world, body).centre_of_mass if body.joint.kind == "free" else (0.0, 0.0, 0.0)
            for body in bodies
        ]
        self.centres = {rows[name]: centre for name, centre in centres(bodies).items()}
        """The centre of mass of each rigid group that moves, in the frame of its topmost body, by that one's row."""
        groups = rigid_groups(self.world)
        self.tops = [rows[groups[body.name]] if groups[body.name] != "world" else -1 for body in bodies]
        """The row of the topmost body of each body's group; −1 of what cannot move."""
        self._nodes = {node.label: node for node in document.walk() if node.label}

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """The state in which the document begins."""
        return initial_state(self.world)

    # --- to a file ------------------------------------------------------------------------------------------------

    def text(self, q: np.ndarray, v: np.ndarray, contact: bool, smooth: Sequence[int]) -> str:
        """The file that begins in the state (q, v); without ``contact`` nothing is solid, and the joints of the rows ``smooth``
        have no dry friction."""
        world = dataclasses.replace(
            self.world, bodies=tuple(self._placed(row, q, v) for row in range(len(self.parents)))
        )
        placed, moving = poses(world), twists(world)
        changes: dict[tuple[Node, str], Sequence[Value]] = {}
        for row, (body, parent) in enumerate(zip(world.bodies, self.parents, strict=True)):
            here = frames.compose(placed[body.name], self._offsets[row])
            around = Pose()
            if parent >= 0:
                around = frames.compose(placed[world.bodies[parent].name], self._offsets[parent])
            place = frames.compose(frames.inverse(around), here)
            node = self._nodes[f"body_{row}"]
            changes[node, "translation"], changes[node, "rotation"] = place.position, turn(place.quaternion)
            if row in self.centres:
                own = placed[body.name]
                centre = frames.add(own.position, frames.rotate(own.quaternion, self.centres[row]))
                linear, angular = moved(moving[body.name], own.position, centre)
                changes[node, "linearVelocity"] = frames.rotate(self.turned, linear)
                changes[node, "angularVelocity"] = frames.rotate(self.turned, angular)
            if body.joint.kind in SCALAR_JOINTS:
                parameters = self._parameters(row)
                changes[parameters, "position"] = (float(body.joint.position[0]),)
            if not contact:
                changes[node, "boundingObject"] = (None,)
        changes |= {(self._parameters(row), "staticFriction"): (0.0,) for row in smooth}
        return text_of(self.document, changes)

    def _parameters(self, row: int) -> Node:
        joint = self._nodes[f"joint_{row}"]
        parameters = joint.node("jointParameters")
        if parameters is None:
            raise joint.refused("has no jointParameters")
        return parameters

    def _placed(self, row: int, q: np.ndarray, v: np.ndarray) -> Body:
        """A body whose joint is in a state."""
        body = self.world.bodies[row]
        position, velocity = q[self.layout.position[row]].tolist(), v[self.layout.velocity[row]].tolist()
        if body.joint.kind == "ball":
            position = frames.normalise(quaternion(position))
        elif body.joint.kind == "free":
            around = frames.normalise(quaternion(position[3:]))
            lever = frames.rotate(around, self.levers[row])
            angular = frames.rotate(around, vector3(velocity[3:]))
            position = (*frames.subtract(vector3(position[:3]), lever), *around)
            velocity = (*frames.subtract(vector3(velocity[:3]), frames.cross(angular, lever)), *angular)
        joint = dataclasses.replace(body.joint, position=tuple(position), velocity=tuple(velocity))
        return dataclasses.replace(body, joint=joint)

    # --- from where Solids are ------------------------------------------------------------------------------------

    def coordinates(
        self, placed: Sequence[Pose], moving: Sequence[tuple[Vector3, Vector3]], last: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) of bodies at ``placed`` that move with ``moving``, linear and angular, whose joints may have come apart: what
        a joint does not let move is left out. Angles are the ones nearest to those of the state ``last`` (nq,)."""
        q, v = np.zeros(self.layout.nq), np.zeros(self.layout.nv)
        for row, body in enumerate(self.world.bodies):
            at_q, at_v, kind, here = self.layout.position[row], self.layout.velocity[row], body.joint.kind, placed[row]
            linear, angular = moving[row]
            if kind == "fixed":
                continue
            if kind == "free":
                lever = frames.rotate(here.quaternion, self.levers[row])
                q[at_q] = (*frames.add(here.position, lever), *positive(here.quaternion))
                speed = frames.add(linear, frames.cross(angular, lever))
                v[at_v] = (*speed, *frames.rotate(frames.conjugate(here.quaternion), angular))
                continue
            origin = body.joint.origin
            if (parent := self.parents[row]) >= 0:
                origin = frames.compose(placed[parent], origin)
                carried, turning = moved(moving[parent], placed[parent].position, here.position)
                linear, angular = frames.subtract(linear, carried), frames.subtract(angular, turning)
            apart = frames.compose(frames.inverse(origin), here)
            if kind == "ball":
                q[at_q] = positive(apart.quaternion)
                v[at_v] = frames.rotate(frames.conjugate(here.quaternion), angular)
                continue
            axis = body.joint.axis
            along = frames.rotate(here.quaternion, axis)
            if kind == "hinge":
                w, *vector = apart.quaternion
                angle = 2.0 * math.atan2(frames.dot(axis, vector3(vector)), w)
                before = float(last[at_q][0])
                q[at_q] = angle + math.tau * round((before - angle) / math.tau)
                v[at_v] = frames.dot(along, angular)
            else:
                q[at_q], v[at_v] = frames.dot(axis, apart.position), frames.dot(along, linear)
        return q, v


def positive(turned: tuple[float, float, float, float]) -> tuple[float, ...]:
    """The one of the two quaternions of a rotation with w ≥ 0."""
    return turned if turned[0] >= 0.0 else tuple(-part for part in turned)
