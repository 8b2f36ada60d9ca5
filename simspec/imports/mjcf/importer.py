"""The importer of MJCF: physics from the compiled model, places and losses from the XML."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from simspec.errors import Location, SpecError
from simspec.imports.draft import tidy
from simspec.imports.elements import APPEARANCE, INFORMATION, LOST, UNUSED, Element, outermost
from simspec.imports.files import Files
from simspec.imports.mjcf import SUFFIXES
from simspec.imports.mjcf.assembly import ROOT, MjcfAssembly, assemble
from simspec.imports.mjcf.bodies import MjcfBodies, add_frames, numbers
from simspec.imports.mjcf.compiled import FEATURES, CompiledMjcf, MjcfFeatures, compile_model
from simspec.imports.mjcf.constraints import add_constraints
from simspec.imports.mjcf.contact import MjcfSurfaces
from simspec.imports.mjcf.parts import NOTE, add_actuators, add_shapes, add_states, outside_the_tree
from simspec.imports.writing import SHARE, round_step
from simspec.language.document import Path_, dotted
from simspec.language.foreign import Account, Imported, ImportOptions, LossSeverity
from simspec.language.models import VERSION
from simspec.language.words import clean_name

# Most of the language is in the compiled numbers. Features of these numbers that a spec does not have are reported at the
# attributes that state them, at every element that has them by a class of defaults.


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


FRAME: Final = _words("name class childclass pos quat axisangle xyaxes zaxis euler")
COMPILED: Final = {
    ROOT: _words("model"),
    "include": _words("file"),
    "compiler": _words(
        "autolimits boundmass boundinertia settotalmass balanceinertia strippath coordinate angle fitaabb eulerseq meshdir "
        "texturedir assetdir discardvisual usethread fusestatic inertiafromgeom inertiagrouprange saveinertial alignfree "
        "exactmeshinertia conflict"
    ),
    "lengthrange": _words("mode useexisting uselimit accel maxforce timeconst timestep inttotal interval tolrange"),
    "option": _words("gravity timestep cone"),
    "flag": _words("gravity constraint equality frictionloss limit contact spring damper"),
    "default": _words("class"),
    "worldbody": _words("name"),
    "body": FRAME,
    "frame": FRAME,
    "replicate": FRAME | _words("count offset sep"),
    "attach": _words("model body frame prefix"),
    "model": _words("name file content_type"),
    "asset": frozenset[str](),
    "inertial": FRAME | _words("mass diaginertia fullinertia"),
    "joint": FRAME
    | _words("type axis range limited ref springref springdamper stiffness damping frictionloss armature"),
    "freejoint": _words("name align"),
    "geom": FRAME
    | _words(
        "type size fromto mass density shellinertia contype conaffinity condim friction rgba fitscale mesh material"
    )
    | _words("priority hfield surfacevel"),
    "mesh": FRAME | _words("file scale inertia refpos refquat vertex face content_type maxhullvert smoothnormal"),
    "hfield": _words("name file content_type nrow ncol size elevation"),
    "material": _words("name class rgba"),
    "contact": frozenset[str](),
    "exclude": _words("name body1 body2 class"),
    "pair": _words("name class geom1 geom2 condim friction"),
    "composite": _words("type prefix count offset quat vertex initial curve size"),
}
"""Elements, and their attributes, that the compiled numbers and the names of the spec carry."""
SETTINGS: Final = {
    "option": (
        "integrator solver iterations tolerance ls_iterations ls_tolerance noslip_iterations noslip_tolerance ccd_iterations "
        "ccd_tolerance sdf_iterations sdf_initpoints jacobian impratio actuatorgroupdisable sleep_tolerance apirate magnetic",
        "a setting of one engine's solver; engines.NAME.settings has those that matter",
    ),
    "flag": (
        "clampctrl warmstart filterparent actuation refsafe sensor midphase eulerdamp autoreset nativeccd island multiccd "
        "energy fwdinv invdiscrete sleep override diagexact ipc speculative passive",
        "a setting of one engine",
    ),
    "body": ("user sleep", "of one engine alone"),
    "joint": ("group user solreflimit solimplimit solreffriction solimpfriction margin", "of one engine alone"),
    "freejoint": ("group", "of a viewer"),
    "geom": ("user group", "of a viewer"),
    "compiler": ("saveinertial", "how a file is written"),
}
"""Attributes that name settings or groups of one engine: reported as information that is lost."""
ASIDE: Final = {
    "visual": (APPEARANCE, "how a viewer draws"),
    "statistic": (APPEARANCE, "the initial view of a viewer"),
    "light": (APPEARANCE, "lights are not in the language"),
    "camera": (INFORMATION, "cameras are not in the language"),
    "texture": (APPEARANCE, "textures are not in the language"),
    "layer": (APPEARANCE, "textures are not in the language"),
    "skin": (APPEARANCE, "skins are not in the language"),
    "sensor": (INFORMATION, "runs record all bodies and joints; sensors are not in the language"),
    "custom": (INFORMATION, "data of a program"),
    "size": (INFORMATION, "sizes of one engine's memory"),
    "site": (INFORMATION, "a place without a name, or in the world itself"),
    "user": (INFORMATION, "data of a program"),
}
"""Elements that are set aside with all that is in them."""
LOOKS: Final = frozenset(("type", "size", "group", "material", "rgba", "user"))
"""Attributes of a site that say how it is drawn."""
KEYFRAME: Final = "keyframe"
"""The section of named states, whose elements the compiler does not name the lines of."""
SECTIONS: Final = {"equality": "equality", "tendon": "tendon", "actuator": "actuator", "keyframe": "key"}
"""Sections whose elements are reported one by one, as features of these kinds."""
PARTS: Final = ("joint",)
"""Elements in one of a section that are carried with it: those that a tendon sums."""
SEPARATE: Final = ("body", "joint", "freejoint", "geom", "pair")
"""Elements of which each has its own features; a class of defaults says what any of those that take it has."""
MATERIAL: Final = "a material's texture and gloss"


def account(assembly: MjcfAssembly, features: MjcfFeatures) -> list[Account]:
    """The fate of everything in all files."""
    by_attribute = _by_attribute(features)
    whole: set[int] = set()
    for root in (assembly.root, *assembly.models):
        waiting = [(root, "")]
        while waiting:
            element, around = waiting.pop()
            if around in SECTIONS:
                whole.add(id(element))
                if around == KEYFRAME and element.attributes.get("name", "") in features.states:
                    _of_state(element, element.attributes.get("name", "") in features.commanded)
                elif around == KEYFRAME:
                    features.add("key", element)
            elif _element(element, around, by_attribute, features):
                waiting += [(child, element.tag) for child in assembly.below(element)]
    for element in features.carried:  # before what a copy of it loses
        _carried(element, features)
    for name, elements in features.having.items():
        feature = FEATURES[name]
        for element in elements:
            if id(element) in whole or f"{element.tag}/*" in feature.attributes.split():
                hint = features.hints.get((name, id(element)), feature.hint)
                element.lose(None, feature.reason, feature.severity, hint)
    for included in assembly.included.values():
        for name in included.attributes:
            included.ignore(name, "an included file has no name in the model")
    accounts = assembly.accounts()
    return [*accounts, *_untold(features, accounts)]


def _of_state(element: Element, commanded: bool) -> None:
    """A key that the spec has as a state; ``commanded``: with its inputs as commands."""
    driven = FEATURES["key.driven"]
    element.take()
    for name in element.attributes:
        if f"key/{name}" in driven.attributes.split() and not (commanded and name == "ctrl"):
            element.lose(name, driven.reason, driven.severity, driven.hint)
        else:
            element.word(name)


def _carried(element: Element, features: MjcfFeatures) -> None:
    """An element of a section that the spec says, with its attributes."""
    element.take()
    softness = FEATURES["equality.softness"]
    for name in element.attributes:
        if name in ("solref", "solimp") and features.has("equality.softness", element):
            element.lose(name, softness.reason, softness.severity, softness.hint)
        else:
            element.word(name)
    for part in element.children(*PARTS):
        for name in part.attributes:
            part.word(name)


def _shown(word: str) -> str:
    tag, _, attribute = word.partition("/")
    if tag == "*":
        return "body"
    return tag if attribute in ("", "*") else f"{tag}/@{attribute}"


def _by_attribute(features: MjcfFeatures) -> dict[str, list[str]]:
    saying: dict[str, list[str]] = {}
    for name in features.having:
        for word in FEATURES[name].attributes.split():
            saying.setdefault(word, []).append(name)
    return saying


def _element(element: Element, around: str, by_attribute: dict[str, list[str]], features: MjcfFeatures) -> bool:
    """Report the fate of an element and its attributes; whether its children have fates as well. ``around``: the tag of
    what it is in, includes aside."""
    tag = element.tag
    in_default = around == "default"
    if tag == "site" and (in_default or id(element) in features.framed):
        element.take()
        for name in element.attributes:
            if name in LOOKS:
                element.lose(name, "how a frame is drawn", APPEARANCE)
            else:
                element.word(name)
        return False
    if tag in ASIDE or (in_default and tag not in COMPILED):
        severity, reason = ASIDE.get(tag, (INFORMATION, "a default is reported at the elements that use it"))
        element.set_aside(None, LOST if tag in ASIDE else UNUSED, reason, severity)
        return False
    if tag in SECTIONS:
        element.take()
        return True
    known = COMPILED.get(tag)
    if known is None:
        return False  # an unknown element is lost
    element.take()
    words, reason = SETTINGS.get(tag, ("", ""))
    aside = words.split()
    for name in element.attributes:
        lost = by_attribute.get(f"{tag}/{name}", [])
        if tag in SEPARATE and not in_default:
            lost = [name for name in lost if features.has(name, element)]
        if lost:
            feature = FEATURES[min(lost, key=lambda entry: list(LossSeverity).index(FEATURES[entry].severity))]
            element.lose(name, feature.reason, feature.severity, feature.hint)
        elif name in aside:
            element.lose(name, reason, INFORMATION)
        elif name in known or f"{tag}/{name}" in _SAID:  # of what could be said by the latter, no element has it
            element.word(name)
        elif tag == "material":
            element.lose(name, MATERIAL, APPEARANCE)
    return True


_SAID: Final = {word for feature in FEATURES.values() for word in feature.attributes.split()}


def _untold(features: MjcfFeatures, accounts: list[Account]) -> Iterator[Account]:
    """Features that no attribute reports: those of classes of defaults, and defaults of an engine."""
    known_losses = {(entry.reason, entry.location) for entry in accounts if entry.fate is LOST}
    anywhere = {entry.reason for entry in accounts if entry.fate is LOST}
    for name, elements in features.having.items():
        feature = FEATURES[name]
        if feature.reason in anywhere and "*" not in feature.attributes:
            continue  # reported at the attribute of its class
        for element in elements:
            if (feature.reason, element.location) not in known_losses:
                yield Account(element.location, element.path, LOST, feature.severity, feature.reason, feature.hint)


FLUID: Final = ("density", "viscosity")


class MjcfImporter:
    """Reads MJCF files, also those that include or attach others."""

    NAME = "MJCF"
    SUFFIXES = SUFFIXES

    def recognises(self, content: bytes) -> bool:
        return outermost(content) == ROOT.encode()

    @staticmethod
    def losses() -> list[tuple[str, LossSeverity, str, str]]:
        """Elements and attributes that files have and a spec has not: their places, the effect of the loss, the reason, and the
        way out."""
        rows = []
        for feature in FEATURES.values():
            words = " ".join(_shown(word) for word in feature.attributes.split())
            rows.append((words, feature.severity, feature.reason, feature.hint))
        for tag, (words, reason) in SETTINGS.items():
            rows.append((" ".join(f"{tag}/@{word}" for word in words.split()), INFORMATION, reason, ""))
        return rows + [(tag, severity, reason, "") for tag, (severity, reason) in ASIDE.items()]

    def read(self, path: Path, shown: str, options: ImportOptions) -> Imported:
        if problems := options.repairs.problems(shown, ()):
            raise SpecError(problems)
        files = Files(path, shown, options)
        assembly = assemble(files)
        return imported(assembly, MjcfBodies(compile_model(assembly), MjcfFeatures()), files)


def imported(assembly: MjcfAssembly, bodies: MjcfBodies, files: Files) -> Imported:
    """The spec of a compiled model; ``bodies``: new, and those of the spec afterwards."""
    model, features = bodies.model, bodies.features
    stated = any(element.tag == "option" and element.has("cone") for element in assembly.everything())
    model.options["cone_stated"] = stated
    bodies.folder = files.path.resolve().parent
    bodies.make()
    if not bodies.names and not model.numbers["ngeom"]:
        raise assembly.root.error("this model has no bodies", code="I113")
    surfaces = MjcfSurfaces(model, features)
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
    name = clean_name(assembly.root.attributes.get("model", "") or files.path.stem)[:150]
    data: dict[str, Any] = {"simspec": VERSION, "name": name}
    data["physics"] = _physics(model, features)
    if contact:
        data["contact"] = contact
    around: dict[str, Any] = data.setdefault("model", {}) if alone else data
    outer: Path_ = ("model",) if alone else ()
    at = (*outer, "bodies")
    around["bodies"] = bodies.data
    if named:
        around["frames"] = named
    if constraints:
        around["constraints"] = constraints
    starts = bodies.starts(at)
    if alone and (states := add_states(bodies, constraints, actuators, starts)):
        around["states"] = states
    if actuators:
        around["actuators"] = actuators
    places: dict[Path_, Location] = {(): assembly.root.location}
    for option in assembly.root.children("option"):
        if "gravity" in option.attributes:
            places["physics", "gravity"] = option.location
    places |= {(*at, *path): place for path, place in bodies.places.items()}
    places |= {(*outer, "constraints", name): place for name, place in bodies.constraint_places.items()}
    comments = {
        dotted((*outer, word, given)): f"named {name!r} in the file"
        for word, given_names in (("bodies", bodies.renamed), ("frames", renamed))
        for name, given in given_names.changed.items()
    }
    if actuators:
        comments[dotted((*outer, "actuators"))] = NOTE
    accounts = account(assembly, features)
    return Imported(tidy(data), places, accounts, files=bodies.files, read=files.read, comments=comments, starts=starts)


def _physics(model: CompiledMjcf, features: MjcfFeatures) -> dict[str, Any]:
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
