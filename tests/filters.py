"""A world whose collision filter has everything, and defects planted into it in every engine's files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from xml.etree import ElementTree

from simspec.dialects.kit.sidecar import SIDECAR, sidecar_text
from simspec.world.types import (
    Body,
    Contact,
    EngineOptions,
    Inertial,
    Joint,
    Material,
    PairContact,
    Pose,
    Shape,
    World,
)
from tests import worlds

SOLID = Inertial(1.0, (0.0, 0.0, 0.1), (0.02, 0.02, 0.02, 0.0, 0.0, 0.0))
AT_REST = (0.0,) * 6


def _link(name: str, parent: str | None, origin: Pose, group: str, *shapes: Shape) -> Body:
    axis = (0.0, 1.0, 0.0)
    joint = Joint(f"{name}_joint", "hinge", parent, origin, axis, (-3.0, 3.0), position=(0.3,), velocity=(0.0,))
    return Body(name, "upper", SOLID, joint, shapes, group)


def _free(name: str, x: float, group: str, *shapes: Shape) -> Body:
    joint = Joint(f"{name}_joint", "free", position=(x, 2.0, 0.5, 1.0, 0.0, 0.0, 0.0), velocity=AT_REST)
    return Body(name, name, SOLID, joint, shapes, group)


def linked(engine: str) -> World:
    """An arm of long links with a hand of three shapes and two materials, two free bodies of three shapes each, a ghost, and a
    floor with a post; groups, names and materials decide who touches. Some pairs need copies where an engine has layers."""
    along = Pose((0.0, 0.0, 0.3))
    bodies = (
        Body(
            "ground",
            "ground",
            Inertial(0.0),
            Joint("ground_joint", "fixed"),
            (
                Shape("floor", "box", (6.0, 6.0, 0.4), Pose((0.0, 0.0, -0.2)), "rubber"),
                Shape("post", "box", (0.1, 0.1, 1.0), Pose((0.6, 0.0, 0.5)), "ice"),
            ),
        ),
        _link("upper", None, Pose((0.0, 0.0, 0.8)), "arm", Shape("upper_rod", "capsule", (0.02, 0.5), along, "rubber")),
        _link(
            "fore", "upper", Pose((0.0, 0.0, 0.6)), "arm", Shape("fore_rod", "capsule", (0.02, 0.5), along, "rubber")
        ),
        _link(
            "hand",
            "fore",
            Pose((0.0, 0.0, 0.6), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))),
            "hand",
            Shape("palm", "box", (0.1, 0.1, 0.04), Pose((0.0, 0.0, 0.05)), "rubber"),
            Shape("finger", "box", (0.02, 0.02, 0.4), Pose((0.06, 0.0, 0.25)), "ice"),
            Shape("pad", "sphere", (0.03,), Pose((0.06, 0.0, 0.5)), "rubber"),
        ),
        _free(
            "tool",
            1.0,
            "default",
            Shape("handle", "box", (0.3, 0.04, 0.04), Pose(), "rubber"),
            Shape("blade", "box", (0.3, 0.02, 0.06), Pose((0.3, 0.0, 0.0)), "ice"),
            Shape("knob", "sphere", (0.04,), Pose((-0.2, 0.0, 0.0)), "rubber"),
        ),
        _free(
            "brick",
            2.0,
            "default",
            Shape("brick_ice", "box", (0.1, 0.1, 0.1), Pose(), "ice"),
            Shape("brick_rubber", "box", (0.1, 0.1, 0.1), Pose((0.15, 0.0, 0.0)), "rubber"),
            Shape("brick_ice_too", "box", (0.1, 0.1, 0.1), Pose((0.3, 0.0, 0.0)), "ice"),
        ),
        _free("ghost", 3.0, "quiet", Shape("ghost_ball", "sphere", (0.05,), Pose(), "ghost")),
    )
    contact = Contact(
        materials=(Material("ghost", 0.2), Material("ice", 0.1), Material("rubber", 0.3)),
        pairs=(
            PairContact("ghost", "ghost", 0.2, 0.0),
            PairContact("ghost", "ice", 0.0, 0.0, collide=False),
            PairContact("ghost", "rubber", 0.3, 0.0),
            PairContact("ice", "ice", 0.1, 0.0),
            PairContact("ice", "rubber", 0.3, 0.0),
            PairContact("rubber", "rubber", 0.3, 0.0),
        ),
        ignored_groups=(("arm", "quiet"),),
        excluded_bodies=(("brick", "fore"), ("brick", "ground"), ("fore", "hand"), ("fore", "upper")),
    )
    accept = (
        *("contact.cone.elliptic", *worlds.FRICTION, "joint.limits.position"),
        "shape.box",
    )
    # explicit pairs pass by MuJoCo's masks and exclusions
    settings = (("explicit_pairs_limit", 0),) if engine == "mujoco" else ()
    options = EngineOptions(engine, settings, accept)
    return worlds.world(bodies, "linked", contact=contact, engines=(options,))


Files = Mapping[str, str]


def _xml(path: str, change: Callable[[ElementTree.Element], None]) -> Callable[[Files], dict[str, str]]:
    def plant(files: Files) -> dict[str, str]:
        root = ElementTree.fromstring(files[path])
        before = ElementTree.tostring(root)
        change(root)
        assert ElementTree.tostring(root) != before
        return {**files, path: ElementTree.tostring(root, encoding="unicode")}

    return plant


def _json(change: Callable[[dict], None]) -> Callable[[Files], dict[str, str]]:
    def plant(files: Files) -> dict[str, str]:
        content = json.loads(files[SIDECAR])
        change(content)
        text = sidecar_text(content)
        assert text != files[SIDECAR]
        return {**files, SIDECAR: text}

    return plant


# --- MuJoCo -------------------------------------------------------------------------------------------------------


def _geom(name: str, **values: str):
    def change(root: ElementTree.Element) -> None:
        for key, value in values.items():
            next(geom for geom in root.iter("geom") if geom.get("name") == name).set(key, value)

    return _xml("model.xml", change)


def _no_masks(root: ElementTree.Element) -> None:
    for geom in root.iter("geom"):
        for name in ("contype", "conaffinity"):
            geom.attrib.pop(name, None)


def _contact(root: ElementTree.Element) -> ElementTree.Element:
    found = root.find("contact")
    assert found is not None
    return found


def _exclude_dropped(first: str, second: str):
    def change(root: ElementTree.Element) -> None:
        contact = _contact(root)
        contact.remove(
            next(e for e in contact.findall("exclude") if {e.get("body1"), e.get("body2")} == {first, second})
        )

    return _xml("model.xml", change)


def _exclude_added(first: str, second: str):
    def change(root: ElementTree.Element) -> None:
        ElementTree.SubElement(_contact(root), "exclude", {"body1": first, "body2": second})

    return _xml("model.xml", change)


def _pair_added(first: str, second: str):
    def change(root: ElementTree.Element) -> None:
        ElementTree.SubElement(_contact(root), "pair", {"geom1": first, "geom2": second})

    return _xml("model.xml", change)


# --- PyBullet -----------------------------------------------------------------------------------------------------


def _classes(content: dict) -> list[dict]:
    return content["collision_filter"]["classes"]


# PyBullet lets two links touch where either's group is in the other's mask (measured): a mask alone changes nothing


def _mask(link: str, change: Callable[[dict], None]):
    """A change of one link's group and mask alone."""

    def edit(content: dict) -> None:
        contact_class = next(entry for entry in _classes(content) if link in entry["links"])
        contact_class["links"].remove(link)
        separate_class = {**contact_class, "links": [link]}
        change(separate_class)
        _classes(content).append(separate_class)

    return _json(edit)


def _open(content: dict) -> None:
    for entry in _classes(content):
        entry["mask"] |= sum(other["group"] for other in _classes(content))


def _pair(key: str, change: Callable[[list], None]):
    return _json(lambda content: change(content["collision_filter"]["excluded"] if key == "urdf" else content[key]))


# --- DART ---------------------------------------------------------------------------------------------------------


def _no_filter(content: dict) -> None:
    content["ignored_groups"] = []


def _class_of(content: dict, node: str) -> str:
    return next(name for name, nodes in content["filter"]["classes"].items() if node in nodes)


def _out_of_class(node: str):
    def edit(content: dict) -> None:
        content["filter"]["classes"][_class_of(content, node)].remove(node)

    return _json(edit)


def _no_longer_solid(name: str):
    """The collision shape goes out of the file, and out of the sidecar."""

    def plant(files: Files) -> dict[str, str]:
        content = json.loads(files[SIDECAR])
        entry = next(shape for shape in content["shapes"] if shape["name"] == name)
        place = [shape["name"] for shape in content["shapes"] if shape["body"] == entry["body"]].index(name)
        root = ElementTree.fromstring(files["world.skel"])
        for copy in entry["surfaces"]:
            node = next(e for e in root.iter("body") if e.get("name") == copy["node"])
            solid = node.findall("collision_shape")
            node.remove(solid[min(place, len(solid) - 1)])
        entry["surfaces"] = []
        return {**files, SIDECAR: sidecar_text(content), "world.skel": ElementTree.tostring(root, encoding="unicode")}

    return plant


def _link_dropped(file: str, name: str):
    def change(root: ElementTree.Element) -> None:
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                if collision.get("name") == name:
                    link.remove(collision)

    return _xml(file, change)


# --- Files world.json: Drake, ODE ---------------------------------------------------------------------------------


def _world_json(change: Callable[[dict], None]) -> Callable[[Files], dict[str, bytes]]:
    def plant(files: Files) -> dict[str, bytes]:
        content = json.loads(files["world.json"])
        change(content)
        text = sidecar_text(content).encode()
        assert text != files["world.json"]
        return {**files, "world.json": text}

    return plant


def _exclusions(key: str, change: Callable[[list], None]):
    return _world_json(lambda content: change(content["apart"][key]))


def _of_shape(name: str, change: Callable[[dict], None]):
    """A change of one shape."""

    def edit(content: dict) -> None:
        change(next(shape for body in content["bodies"] for shape in body["shapes"] if shape["name"] == name))

    return _world_json(edit)


def _in_group(name: str, group: str):
    return _world_json(
        lambda content: next(body for body in content["bodies"] if body["name"] == name).update(group=group)
    )


OF_WORLD_FILES: Mapping[str, Callable[[Files], dict[str, str]]] = {
    "group filter dropped": _exclusions("groups", lambda pairs: pairs.clear()),
    "a group has lost a body": _in_group("upper", "default"),
    "a group has one body more": _in_group("hand", "arm"),
    "exclusion dropped": _exclusions("bodies", lambda pairs: pairs.remove(["brick", "ground"])),
    "exclusion in the arm dropped": _exclusions("bodies", lambda pairs: pairs.remove(["fore", "upper"])),
    "exclusion too many": _exclusions("bodies", lambda pairs: pairs.append(["ground", "tool"])),
    "exclusion too many in the arm": _exclusions("bodies", lambda pairs: pairs.append(["hand", "upper"])),
}
"""Tests for every engine that reads ``world.json``."""
DEFECTS: Mapping[str, Mapping[str, Callable[[Files], dict[str, str]]]] = {
    "mujoco": {
        "group filter dropped": _xml("model.xml", _no_masks),
        "mask of the second shape": _geom("finger", contype="1073741824", conaffinity="1073741824"),
        "mask of the third shape": _geom("pad", contype="0", conaffinity="0"),
        "mask of a long link opened": _geom("upper_rod", contype="1", conaffinity="2147483647"),
        "exclusion dropped": _exclude_dropped("brick", "ground"),
        "exclusion in the arm dropped": _exclude_dropped("fore", "upper"),
        "exclusion too many": _exclude_added("tool", "ground"),
        "exclusion too many in the arm": _exclude_added("upper", "hand"),
        "an explicit pair past the filter": _pair_added("ghost_ball", "upper_rod"),
        "third shape not solid": _geom("brick_ice_too", contype="0", conaffinity="0"),
    },
    "pybullet": {
        "group filter dropped": _json(_open),
        "mask of the second material's link": _mask("hand__ice.0", lambda entry: entry.update(group=0, mask=0)),
        "mask of one body": _mask("tool", lambda entry: entry.update(group=0, mask=0)),
        "mask of a long link opened": _mask("upper", lambda entry: entry.update(mask=2**31 - 1)),
        "exclusion dropped": _pair("urdf", lambda pairs: pairs.remove(["brick", "ground"])),
        "exclusion in the arm dropped": _pair(
            "urdf", lambda pairs: pairs.remove(["fore__rubber.1", "upper__rubber.1"])
        ),
        "exclusion too many": _pair("urdf", lambda pairs: pairs.append(["ground__rubber.1", "tool__rubber.1"])),
        "exclusion too many in the arm": _pair(
            "urdf", lambda pairs: pairs.append(["hand__rubber.1", "upper__rubber.1"])
        ),
        "third shape not solid": _link_dropped("brick.urdf", "brick_ice_too"),
    },
    "dart": {
        "group filter dropped": _json(_no_filter),
        "a node out of its class": _out_of_class("hand"),
        "a ghost's node out of its class": _out_of_class("ghost"),
        "a group has lost a body": _json(lambda content: content["groups"]["arm"].remove("upper")),
        "a group has one body more": _json(lambda content: content["groups"]["arm"].append("hand")),
        "exclusion dropped": _pair("excluded", lambda pairs: pairs.remove(["brick", "ground"])),
        "exclusion in the arm dropped": _pair("excluded", lambda pairs: pairs.remove(["fore", "upper"])),
        "exclusion too many": _pair("excluded", lambda pairs: pairs.append(["ground", "tool"])),
        "exclusion too many in the arm": _pair("excluded", lambda pairs: pairs.append(["hand", "upper"])),
        "third shape not solid": _no_longer_solid("brick_ice_too"),
    },
    "drake": {
        **OF_WORLD_FILES,
        "a pair of materials meets no longer": _world_json(lambda content: content["meets"].pop(0)),
        "a pair of materials meets in another layer": _world_json(
            lambda content: content["meets"][2].__setitem__(2, 7)
        ),
        "a copy is not there": _of_shape("pad", lambda shape: shape["copies"].pop()),
        "third shape not solid": _of_shape("brick_ice_too", lambda shape: shape.update(material="", copies=[])),
    },
    "gazebo": {
        **OF_WORLD_FILES,
        "a pair of materials meets no longer": _world_json(lambda content: content["meets"].pop(0)),
        "a copy is not there": _of_shape("pad", lambda shape: shape["copies"].pop()),
        "third shape not solid": _of_shape("brick_ice_too", lambda shape: shape.update(material="", copies=[])),
    },
    "ode": {
        **OF_WORLD_FILES,
        "a pair of materials meets no longer": _json(lambda content: content["laws"][1].update(collide=False)),
        "third shape not solid": _of_shape("brick_ice_too", lambda shape: shape.update(material="", copies=[])),
    },
}
"""Of every engine the defects by name, from files to files."""
