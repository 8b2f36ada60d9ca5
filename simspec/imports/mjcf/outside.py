"""What a compiled model has beside its tree of bodies: constraints, tendons, actuators, fluids, named states."""

from __future__ import annotations

from simspec.imports.mjcf.bodies import Bodies


def outside_the_tree(bodies: Bodies) -> None:
    """Say as features what the spec does not have of it."""
    model, features = bodies.model, bodies.features
    if model.options["density"] or model.options["viscosity"]:
        features.add("option.fluid", model.root)
    for number, part in model.parts["tendon"].items():
        features.add("tendon" if _acts(bodies, number) else "tendon.passive", part.element)
    for number, part in model.parts["actuator"].items():
        features.add("actuator.inertia" if _has_inertia(bodies, number) else "actuator", part.element)
    for part in model.parts["key"].values():
        features.add("key", part.element)
    if model.numbers["nplugin"]:
        features.add("plugin", model.root)


def _acts(bodies: Bodies, number: int) -> bool:
    """Whether a tendon exerts forces by itself."""
    model = bodies.model
    words = ("stiffness", "damping", "frictionloss", "armature", "limited", "actfrclimited")
    return any(model[f"tendon_{word}"][number].any() for word in words)


def _has_inertia(bodies: Bodies, number: int) -> bool:
    """Whether an actuator changes the inertia or damping of what it drives."""
    arrays = (bodies.model.get("actuator_armature"), bodies.model.get("actuator_damping"))
    return any(values is not None and values[number].any() for values in arrays)
