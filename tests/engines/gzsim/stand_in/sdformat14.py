"""A stand-in of the types of SDF that gz sim's bindings give."""

import enum


class JointType(enum.Enum):
    """The types of joints that simspec writes."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


class JointAxis:
    """An ``<axis>``."""

    def __init__(self, xyz, numbers):
        self._xyz, self._numbers = xyz, numbers

    def xyz(self):
        return self._xyz

    def __getattr__(self, name):
        if name not in ("lower", "upper", "effort", "damping", "friction", "spring_reference", "spring_stiffness"):
            raise AttributeError(name)
        return lambda: self._numbers[name]
