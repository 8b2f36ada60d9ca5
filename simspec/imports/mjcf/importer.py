"""The importer of MJCF: physics from the compiled model, places and losses from the XML."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from simspec.errors import Location
from simspec.imports.draft import plain
from simspec.imports.elements import outermost
from simspec.imports.files import Files
from simspec.imports.mjcf.actuators import NOTE, add_actuators
from simspec.imports.mjcf.assembly import ROOT, Assembly, assemble
from simspec.imports.mjcf.bodies import Bodies, numbers
from simspec.imports.mjcf.compiled import Compiled, compile_model
from simspec.imports.mjcf.equalities import add_constraints
from simspec.imports.mjcf.fates import account, every_loss
from simspec.imports.mjcf.features import Features
from simspec.imports.mjcf.named_frames import add_frames
from simspec.imports.mjcf.outside import outside_the_tree
from simspec.imports.mjcf.shapes import add_shapes
from simspec.imports.mjcf.states import add_states
from simspec.imports.mjcf.surfaces import Surfaces
from simspec.imports.timestep import SHARE, round_step
from simspec.language.document import Path_
from simspec.language.foreign import Imported, ImportOptions, Severity
from simspec.language.models import VERSION
from simspec.language.words import clean_name

FLUID: Final = ("density", "viscosity")


class MjcfImporter:
    """Reads MJCF files, also those that include or attach others."""

    NAME = "MJCF"
    SUFFIXES = (".xml", ".mjcf")

    def recognises(self, content: bytes) -> bool:
        return outermost(content) == ROOT.encode()

    @staticmethod
    def losses() -> list[tuple[str, Severity, str, str]]:
        """What files say and a spec does not: where, what that changes, why, and the way out."""
        return every_loss()

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        files = Files(path, shown, options)
        assembly = assemble(files)
        return imported(assembly, Bodies(compile_model(assembly), Features()), files)


def imported(assembly: Assembly, bodies: Bodies, files: Files) -> Imported:
    """The spec of a compiled model; ``bodies``: new, and those of the spec afterwards."""
    model, features = bodies.model, bodies.features
    _state_cone(assembly, model)
    bodies.folder = files.path.resolve().parent
    bodies.make()
    if not bodies.names and not model.numbers["ngeom"]:
        raise assembly.root.error("this model has no bodies")
    surfaces = Surfaces(model, features)
    add_shapes(bodies, surfaces)
    constraints = add_constraints(bodies, surfaces)
    names = bodies.names if bodies.ground is None else {0: bodies.ground, **bodies.names}
    roots = [name for name, body in bodies.data.items() if "parent" not in body]
    alone = len(roots) == 1 and bool(bodies.names)
    contact = surfaces.contact(names, alone)
    if surfaces.touching_joined:
        contact["touch"] = [[names[parent], names[number]] for number, parent in surfaces.touching_joined]
    for number, group in surfaces.groups.items():
        bodies.data[names[number]]["collision_group"] = group
    actuators = add_actuators(bodies, constraints)
    named, renamed = add_frames(bodies)
    outside_the_tree(bodies, constraints)
    data: dict[str, Any] = {"simspec": VERSION, "name": _name(assembly, files)}
    data["physics"] = _physics(model, features)
    if contact:
        data["contact"] = contact
    at: Path_ = ("bodies",)
    if alone:
        data["model"] = {"bodies": bodies.data}
        at = ("model", "bodies")
    else:
        data["bodies"] = bodies.data
    around = data["model"] if alone else data
    if named:
        around["frames"] = named
    if constraints:
        around["constraints"] = constraints
    starts = bodies.starts(at)
    if alone and (states := add_states(bodies, constraints, actuators, starts)):
        data["model"]["states"] = states
    if actuators:
        around["actuators"] = actuators
    places: dict[Path_, Location] = {(): assembly.root.location}
    places |= {(*at, *path): place for path, place in bodies.places.items()}
    places |= {(*at[:-1], "constraints", name): place for name, place in bodies.constraint_places.items()}
    comments = {
        ".".join(map(str, (*at, given))): f"named {name!r} in the file"
        for name, given in bodies.renamed.changed.items()
    }
    comments |= {
        ".".join(map(str, (*at[:-1], "frames", given))): f"named {name!r} in the file"
        for name, given in renamed.changed.items()
    }
    if actuators:
        comments["model.actuators" if alone else "actuators"] = NOTE
    return Imported(
        _tidy(data),
        places,
        account(assembly, features),
        files=bodies.files,
        read=files.read,
        comments=comments,
        starts=starts,
    )


def _tidy(value: Any) -> Any:
    """Plain data with whole numbers as a person writes them."""
    if isinstance(value, dict):
        return {key: _tidy(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_tidy(item) for item in value]
    return plain(value) if isinstance(value, float) else value


def _name(assembly: Assembly, files: Files) -> str:
    return clean_name(assembly.root.attributes.get("model", "") or files.path.stem)[:150]


def _state_cone(assembly: Assembly, model: Compiled) -> None:
    """Whether the file says the friction cone; where it does not, the spec leaves its own default."""
    stated = any(element.tag == "option" and element.has("cone") for element in assembly.everything())
    model.options["cone_stated"] = stated


def _physics(model: Compiled, features: Features) -> dict[str, Any]:
    gravity = [0.0, 0.0, 0.0] if model.disabled("gravity") else numbers(model.options["gravity"])
    timestep = float(model.options["timestep"])
    if model.stable_step is not None and timestep > SHARE * model.stable_step:
        features.add("option.timestep", model.root)
        timestep = round_step(SHARE * model.stable_step)
    physics: dict[str, Any] = {"gravity": gravity, "timestep": timestep}
    if model.has_fluid:
        physics["fluid"] = {name: float(model.options[name]) for name in FLUID if float(model.options[name])}
        if any(wind := numbers(model.options["wind"])):
            physics["fluid"]["velocity"] = wind
    return physics
