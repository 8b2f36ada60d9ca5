"""What becomes of every element and attribute of an MJCF file.

What the compiler reads is carried by the compiled numbers; that is most of the language. What those numbers have and the spec
does not say are features (``features.py``): each is told at the attributes that say it, at every element that has it by a
class of defaults, and never left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from simspec.imports.elements import Element
from simspec.imports.mjcf.assembly import ROOT, Assembly
from simspec.imports.mjcf.features import FEATURES, Features
from simspec.language.foreign import Account, Fate, Severity

_INFORMATION, _APPEARANCE = Severity.INFORMATION, Severity.APPEARANCE


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
UNUSED: Final = {
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
"""Attributes that name settings or groups of one engine: told as information that is lost."""
ASIDE: Final = {
    "visual": (_APPEARANCE, "how a viewer draws"),
    "statistic": (_APPEARANCE, "what a viewer begins with"),
    "light": (_APPEARANCE, "lights are not in the language"),
    "camera": (_INFORMATION, "cameras are not in the language"),
    "texture": (_APPEARANCE, "textures are not in the language"),
    "layer": (_APPEARANCE, "textures are not in the language"),
    "skin": (_APPEARANCE, "skins are not in the language"),
    "sensor": (_INFORMATION, "runs record all bodies and joints; sensors are not in the language"),
    "custom": (_INFORMATION, "data of a program"),
    "size": (_INFORMATION, "sizes of one engine's memory"),
    "site": (_INFORMATION, "a place without a name, or in the world itself"),
    "user": (_INFORMATION, "data of a program"),
}
"""Elements that are set aside with all that is in them."""
LOOKS: Final = frozenset(("type", "size", "group", "material", "rgba", "user"))
"""Attributes of a site that say how it is drawn."""
KEYFRAME: Final = "keyframe"
"""The section of named states, whose elements the compiler does not name the lines of."""
SECTIONS: Final = {"equality": "equality", "tendon": "tendon", "actuator": "actuator", "keyframe": "key"}
"""Sections whose elements are told one by one, as features of these kinds."""
PARTS: Final = ("joint",)
"""Elements in one of a section that are carried with it: those that a tendon sums."""
ONE_BY_ONE: Final = ("body", "joint", "freejoint", "geom", "pair")
"""Elements of which each has its own features; a class of defaults says what any of those that take it has."""
MATERIAL: Final = "a material's texture and gloss"


def account(assembly: Assembly, features: Features) -> list[Account]:
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
                element.set_aside(None, Fate.LOST, feature.reason, feature.severity, hint)
    for included in assembly.included.values():
        for name in included.attributes:
            included.set_aside(name, Fate.UNUSED, "what is included has no name of its own", _INFORMATION)
    accounts = assembly.accounts()
    return [*accounts, *_untold(features, accounts)]


def _of_state(element: Element, commanded: bool) -> None:
    """A key that the spec has as a state; ``commanded``: with its inputs as commands."""
    driven = FEATURES["key.driven"]
    element.take()
    for name in element.attributes:
        if f"key/{name}" in driven.attributes.split() and not (commanded and name == "ctrl"):
            element.set_aside(name, Fate.LOST, driven.reason, driven.severity, driven.hint)
        else:
            element.word(name)


def _carried(element: Element, features: Features) -> None:
    """An element of a section that the spec says, with its attributes."""
    element.take()
    softness = FEATURES["equality.softness"]
    for name in element.attributes:
        if name in ("solref", "solimp") and features.has("equality.softness", element):
            element.set_aside(name, Fate.LOST, softness.reason, softness.severity, softness.hint)
        else:
            element.word(name)
    for part in element.look():
        if part.tag in PARTS:
            part.take()
            for name in part.attributes:
                part.word(name)


def every_loss() -> list[tuple[str, Severity, str, str]]:
    """What files may say and a spec does not: elements and attributes, what that changes, why, and the way out."""
    rows = []
    for feature in FEATURES.values():
        words = " ".join(_shown(word) for word in feature.attributes.split())
        rows.append((words, feature.severity, feature.reason, feature.hint))
    for tag, (words, reason) in UNUSED.items():
        rows.append((" ".join(f"{tag}/@{word}" for word in words.split()), _INFORMATION, reason, ""))
    for tag, (severity, reason) in ASIDE.items():
        rows.append((tag, severity, reason, ""))
    return rows


def _shown(word: str) -> str:
    """An element or attribute as accounts write it."""
    tag, _, attribute = word.partition("/")
    if tag == "*":
        return "body"
    return tag if attribute in ("", "*") else f"{tag}/@{attribute}"


def _by_attribute(features: Features) -> dict[str, list[str]]:
    """The features of the model by the attributes that say them."""
    saying: dict[str, list[str]] = {}
    for name in features.having:
        for word in FEATURES[name].attributes.split():
            saying.setdefault(word, []).append(name)
    return saying


def _element(element: Element, around: str, by_attribute: dict[str, list[str]], features: Features) -> bool:
    """Say what becomes of an element and its attributes; whether what is in it is asked for, too. ``around``: the tag of
    what it is in, includes aside."""
    tag = element.tag
    in_default = around == "default"
    if tag == "site" and (in_default or id(element) in features.framed):
        element.take()
        for name in element.attributes:
            if name in LOOKS:
                element.set_aside(name, Fate.LOST, "how a frame is drawn", _APPEARANCE)
            else:
                element.word(name)
        return False
    if tag in ASIDE or (in_default and tag not in COMPILED):
        severity, reason = ASIDE.get(tag, (_INFORMATION, "what it gives is told where it is used"))
        element.set_aside(None, Fate.LOST if tag in ASIDE else Fate.UNUSED, reason, severity)
        return False
    if tag in SECTIONS:
        element.take()
        return True
    known = COMPILED.get(tag)
    if known is None:
        return False  # nobody knows it: it is lost
    element.take()
    words, reason = UNUSED.get(tag, ("", ""))
    aside = words.split()
    for name in element.attributes:
        lost = by_attribute.get(f"{tag}/{name}", [])
        if tag in ONE_BY_ONE and not in_default:
            lost = [one for one in lost if features.has(one, element)]
        if lost:
            feature = FEATURES[min(lost, key=lambda one: list(Severity).index(FEATURES[one].severity))]
            element.set_aside(name, Fate.LOST, feature.reason, feature.severity, feature.hint)
        elif name in aside:
            element.set_aside(name, Fate.LOST, reason, _INFORMATION)
        elif name in known or f"{tag}/{name}" in _SAID:  # of what could be said by the latter, no element has it
            element.word(name)
        elif tag == "material":
            element.set_aside(name, Fate.LOST, MATERIAL, _APPEARANCE)
    return True


_SAID: Final = {word for feature in FEATURES.values() for word in feature.attributes.split()}


def _untold(features: Features, accounts: list[Account]) -> Iterator[Account]:
    """Features that no attribute told: those of classes of defaults, and what an engine does by default."""
    told = {(entry.reason, entry.location) for entry in accounts if entry.fate is Fate.LOST}
    anywhere = {entry.reason for entry in accounts if entry.fate is Fate.LOST}
    for name, elements in features.having.items():
        feature = FEATURES[name]
        if feature.reason in anywhere and "*" not in feature.attributes:
            continue  # told at the attribute of its class
        for element in elements:
            if (feature.reason, element.location) not in told:
                yield Account(element.location, element.path, Fate.LOST, feature.severity, feature.reason, feature.hint)
