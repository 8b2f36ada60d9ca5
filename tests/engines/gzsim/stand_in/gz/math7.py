"""A stand-in of the numbers that gz sim's bindings take and give."""

import numpy as np


class Vector3d:
    """Three numbers."""

    def __init__(self, x=0.0, y=0.0, z=0.0):
        self.values = np.array([x, y, z], dtype=float)

    def x(self):
        return float(self.values[0])

    def y(self):
        return float(self.values[1])

    def z(self):
        return float(self.values[2])


class Quaterniond:
    """w x y z."""

    def __init__(self, w=1.0, x=0.0, y=0.0, z=0.0):
        self.values = np.array([w, x, y, z], dtype=float)

    def w(self):
        return float(self.values[0])

    def x(self):
        return float(self.values[1])

    def y(self):
        return float(self.values[2])

    def z(self):
        return float(self.values[3])


class Pose3d:
    """A place and a turn."""

    def __init__(self, position, rotation):
        self._position, self._rotation = position, rotation

    def pos(self):
        return self._position

    def rot(self):
        return self._rotation


class Matrix3d:
    """Nine numbers, by row and column."""

    def __init__(self, rows):
        self._rows = np.array(rows, dtype=float)

    def __call__(self, row, column):
        return float(self._rows[row, column])


class MassMatrix3d:
    """A mass and its moments."""

    def __init__(self, mass):
        self._mass = mass

    def mass(self):
        return self._mass


class Inertiald:
    """A mass, where its centre is, and its moments in the axes of the world."""

    def __init__(self, mass, pose, moments):
        self._mass, self._pose, self._moments = mass, pose, moments

    def mass_matrix(self):
        return MassMatrix3d(self._mass)

    def pose(self):
        return self._pose

    def moi(self):
        return Matrix3d(self._moments)
