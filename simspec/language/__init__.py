"""The language of specs. The models are exported here for building specs in Python:

>>> from simspec.language import Body, File, Joint
>>> from simspec.language.load import Spec
>>> rod = Body(mass="2 kg", inertia={"principal": [0.1, 0.1, 0.01]}, joint=Joint(type="hinge", axis=[0, 1, 0]))
>>> world = Spec.from_data(File(simspec=1, name="pendulum", bodies={"rod": rod})).resolve()

Everything is imported when it is first used.
"""

from __future__ import annotations

from typing import Any

_HOME = {
    "Spec": "load",
    **dict.fromkeys(("Body", "EngineOptions", "File", "Model", "Physics", "Record", "Use"), "models"),
    **dict.fromkeys(("Array", "Jitter"), "arrays"),
    **dict.fromkeys(("Combine", "Contact", "Group", "Material", "Pair"), "contact"),
    "Controller": "control",
    **dict.fromkeys(("Joint", "Limits", "Spring"), "joints"),
    **dict.fromkeys(("Box", "Capsule", "Cylinder", "Ellipsoid", "Plane", "Sphere"), "shapes"),
    **dict.fromkeys(("Inertia", "Orientation", "Pose", "Shape", "Tensor", "Velocity"), "shapes"),
    "Expectation": "expectations",
}
"""Where each public name lives."""

__all__ = sorted(_HOME)  # noqa: PLE0605 (a list all the same; a literal would be a second place to keep)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'simspec.language' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"simspec.language.{_HOME[name]}"), name)
