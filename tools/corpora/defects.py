"""Hard defects of URDF and SDF files, found without simspec: files that no importer can read without repairs."""

from __future__ import annotations

import math
import re
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

RULE = """A URDF has a *hard defect* where it is no model that a body can have: it is not well-formed or is xacro that is not
expanded; a link, joint or file that it names is not in the package; two links or two joints have one name, links are their own
parents, or several have none; a number is missing or not finite, or a lower limit is above the upper, or a joint
that has a range says neither; an inertial has no mass or
no moments, a mass or a principal moment is below 0, or the largest moment exceeds the sum of the others (by more than 10⁻⁶ of
it); a link that a joint moves has no mass or no moments. A separate reader finds them (`tools/corpora/defects.py`), which
shares nothing with the importer."""
SDF_RULE = """An SDF file has a *hard defect* where it is not well-formed; a file that it names is not in the package; or
a link of a model that is not static, and that no joint fixes to the world, has a mass or a moment that is not above 0, or
moments of which the largest exceeds the sum of the others (by more than 10⁻⁶ of it)."""
SLACK = 1e-6
"""Relative: by so much may moments break an inequality, as numbers that are written with seven digits do."""
MOVING = ("revolute", "continuous", "prismatic", "planar", "floating")


def defects(path: Path, root: Path) -> list[str]:
    """The kinds of hard defects of a file in a package."""
    content = path.read_bytes()
    try:
        robot = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        if "unbound prefix" not in str(error):
            return ["not well-formed"]
        # a prefix that is not declared: elements with it are not URDF's
        robot = ElementTree.fromstring(re.sub(rb"(</?|\s)([A-Za-z_]\w*):(?=[A-Za-z_])", rb"\1\2_", content))
    for element in robot.iter():
        expression = any("${" in value or "$(arg" in value for value in element.attrib.values())
        if expression or re.match(r"xacro_|\{[^}]*xacro[^}]*\}", str(element.tag)):
            return ["unexpanded xacro"]
    links, joints = robot.findall("link"), robot.findall("joint")
    kinds = [*_names(links, joints), *_files(robot, root, path.parent), *_limits(joints)]
    try:
        kinds += [*_numbers(robot), *_masses(links, joints)]
    except ValueError:
        kinds.append("no number")
    return list(dict.fromkeys(kinds))


def sdf_defects(path: Path, root: Path) -> list[str]:
    """The kinds of hard defects of an SDF file in a package."""
    try:
        document = ElementTree.fromstring(path.read_bytes())
    except ElementTree.ParseError:
        return ["not well-formed"]
    kinds = []
    for address in document.iter("uri"):
        text = (address.text or "").strip()
        if text.startswith(("model:", "package:", "file:")):
            found = bool(_named(root, text.rpartition("/")[2]))
        else:  # relative to the file that names it
            found = "://" in text or (path.parent / text).exists()
        if not found:
            kinds.append("a file that is not there")
    for model in document.iter("model"):
        if model.findtext("static", "").strip() in ("true", "1"):
            continue
        fixed = {
            joint.findtext("child", "").strip()
            for joint in model.findall("joint")
            if joint.get("type") == "fixed" and joint.findtext("parent", "").strip() == "world"
        }
        for link in model.findall("link"):
            try:
                kinds += [] if link.get("name") in fixed else _sdf_mass(link.find("inertial"))
            except ValueError:
                kinds.append("no number")
    return list(dict.fromkeys(kinds))


def _sdf_mass(inertial: Any) -> list[str]:
    """Defects of a mass and its moments; the defaults of SDF are 1, and 0 off the diagonal."""
    if inertial is None:
        return []
    tensor = inertial.find("inertia")
    moments = {} if tensor is None else {element.tag: float(element.text or "") for element in tensor}
    xx, yy, zz = (moments.get(word, 1.0) for word in ("ixx", "iyy", "izz"))
    xy, xz, yz = (moments.get(word, 0.0) for word in ("ixy", "ixz", "iyz"))
    low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    kinds = ["a moving link has no mass"] if float(inertial.findtext("mass", "1")) <= 0.0 else []
    if low <= 0.0:
        kinds.append("a moment that is not above 0")
    elif high > (low + middle) * (1.0 + SLACK):
        kinds.append("the triangle inequality")
    return kinds


DEFECTS = {"urdf": defects, "sdf": sdf_defects}
"""By language: languages that are not named have no rule."""


def _names(links: list[Any], joints: list[Any]) -> list[str]:
    kinds = []
    names = [link.get("name") for link in links]
    parents = [_link(joint, "parent") for joint in joints]
    children = [_link(joint, "child") for joint in joints]
    if len(set(names)) < len(names) or len({joint.get("name") for joint in joints}) < len(joints):
        kinds.append("one name twice")
    if not set(parents) | set(children) <= set(names) or not links:
        kinds.append("a link that is not there")
    mimicked = {mimic.get("joint") for joint in joints for mimic in joint.findall("mimic")}
    if not mimicked <= {joint.get("name") for joint in joints}:
        kinds.append("a joint that is not there")
    if len(set(children)) < len(children) or len(set(names) - set(children)) != 1:
        kinds.append("no tree")
    return kinds


def _link(joint: Any, word: str) -> str:
    element = joint.find(word)
    return "" if element is None else element.get("link", "")


def _files(robot: Any, root: Path, folder: Path) -> list[str]:
    for mesh in robot.iter("mesh"):
        text = mesh.get("filename", "")
        if "://" not in text and "$(find" not in text:  # relative to the file that names it
            if not text or not (folder / text.lstrip("/")).is_file():
                return ["a file that is not there"]
            continue
        place = re.sub(r"^(package|model|file)://[^/]*/?", "", text).lstrip("./")
        name = place.rpartition("/")[2]
        if not place or not any(found.as_posix().endswith(place) for found in _named(root, name)):
            return ["a file that is not there"]
    return []


_FILES: dict[Path, dict[str, list[Path]]] = {}


def _named(root: Path, name: str) -> list[Path]:
    if root not in _FILES:
        by_name: dict[str, list[Path]] = {}
        for path in root.rglob("*"):
            by_name.setdefault(path.name, []).append(path)
        _FILES[root] = by_name
    return _FILES[root].get(name, [])


def _limits(joints: list[Any]) -> list[str]:
    for joint in joints:
        limit = joint.find("limit")
        if joint.get("type") in ("revolute", "prismatic") and limit is not None:
            if limit.get("lower") is None and limit.get("upper") is None:
                return ["a joint without a range"]
            try:
                if float(limit.get("lower", "0")) > float(limit.get("upper", "0")):
                    return ["the lower limit is above the upper"]
            except ValueError:
                return ["no number"]
    return []


def _numbers(robot: Any) -> list[str]:
    for element in robot.iter():
        for word, count in (("xyz", 3), ("rpy", 3), ("size", 3), ("scale", 3)):
            text = element.get(word)
            if element.tag in ("origin", "axis", "box", "mesh") and text is not None:
                values = [float(part) for part in text.split()]
                if len(values) != count or not all(map(math.isfinite, values)):
                    return ["no number"]
    return []


def _masses(links: list[Any], joints: list[Any]) -> list[str]:
    kinds = []
    group = _groups(links, joints)
    total: Counter[str] = Counter()
    moments: Counter[str] = Counter()
    moved = {group.get(_link(joint, "child"), "") for joint in joints if joint.get("type") in MOVING}
    by_group: dict[str, list[str]] = {}
    for link in links:
        inertial = link.find("inertial")
        if inertial is None:
            continue
        name = link.get("name")
        mass, tensor = inertial.find("mass"), inertial.find("inertia")
        if mass is None or mass.get("value") is None or tensor is None:
            if mass is not None and mass.get("value") is not None:
                total[group[name]] += float(mass.get("value"))  # type: ignore[assignment]  # a root that has a mass moves
            by_group.setdefault(group[name], []).append("an incomplete inertial")
            continue
        if any(tensor.get(word) is None for word in ("ixx", "iyy", "izz")):
            by_group.setdefault(group[name], []).append("an incomplete inertial")
            continue
        xx, yy, zz, xy, xz, yz = (float(tensor.get(word, "0")) for word in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if float(mass.get("value")) < 0.0 or low < -SLACK * max(high, -low):
            by_group.setdefault(group[name], []).append("a mass or a moment below 0")
        elif high > (low + middle) * (1.0 + SLACK):
            by_group.setdefault(group[name], []).append("the triangle inequality")
        total[group[name]] += float(mass.get("value"))  # type: ignore[assignment]
        moments[group[name]] += abs(high)
    root = next((group[link.get("name")] for link in links if group[link.get("name")] not in moved), "")
    for name, found in by_group.items():
        if name in moved or total[root]:  # links fixed to the world need none
            kinds += found
    kinds += ["a link that a joint moves has no mass" for name in moved if not total[name] and name not in by_group]
    kinds += ["a link that a joint moves has no moments" for name in moved if total[name] and not moments[name]]
    return kinds


def _groups(links: list[Any], joints: list[Any]) -> dict[str, str]:
    """For each link the one on top of those that it is fixed to."""
    fixed = {_link(joint, "child"): _link(joint, "parent") for joint in joints if joint.get("type") == "fixed"}
    tops = {}
    for link in links:
        name, seen = link.get("name"), set()
        while name in fixed and name not in seen:
            seen.add(name)
            name = fixed[name]
        tops[link.get("name")] = name
    return tops
