"""``simspec compile --explain``: how each engine has the scenario's contact law, and why its solver is set as it is."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from simspec.attribution.candidates import CandidateKind
from simspec.attribution.configuration import model_lines
from simspec.attribution.explanation import Explanation
from simspec.attribution.measure import RUN, Swap, acting, useful
from simspec.attribution.sentences import WORDS as CLASS_WORDS
from simspec.attribution.sentences import percent, ranged, verdict
from simspec.attribution.windows import ALL, CLASSES
from simspec.compiler import Compiled, write_folder
from simspec.contact import ContactPlan, Rules, contact_plan
from simspec.dialects.kit.contract import dialects
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import Value, idle_settings, pair_settings, resolve_settings
from simspec.files import scratch_folder
from simspec.language.vocabulary import COMBINED_QUANTITIES
from simspec.report.matrix import WORDS
from simspec.report.screen import console, plain
from simspec.report.study.runs import Done, StudyTable, finite
from simspec.report.table import DIM, Table, TableCell
from simspec.world.actions import JointController
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.types import Hardness, PairContact, Surface, World

SIGNS: Mapping[str, str] = {"max": "max", "min": "min", "product": "×", "cross": "crossed with"}
"""How a table writes a rule of combination between two numbers."""
UNITS: Mapping[str, str] = {
    "torsional_friction": " m",
    "rolling_friction": " m",
    "restitution_threshold": " m/s",
    "time_constant": " s",
    "stiffness": " N/m",
    "damping": " N s/m",
}
GAINS: Mapping[str, Mapping[str, str]] = {
    "hinge": {"kp": "N m/rad", "kd": "N m s/rad", "effort": "N m"},
    "slide": {"kp": "N/m", "kd": "N s/m", "effort": "N"},
}
"""Units of a controller's numbers, by the type of its joints: gains, largest effort."""


@dataclasses.dataclass(frozen=True)
class PairExplained:
    """How a pair of materials is realised: ``how`` in words; ``by_numbers``: the numbers of the two materials give it;
    ``explicit``: pairs of shapes that the engine's files list, each with this law; ``layer`` and ``layers``: in which layer
    of copies they meet, of how many; ``settings``: solver settings of its own."""

    first: str
    second: str
    law: dict[str, Any]
    how: str
    by_numbers: bool
    explicit: int
    layer: int
    layers: int
    settings: dict[str, Value] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class SettingExplained:
    """A solver setting: its value, what the compiler made of that for this world, whether the spec gave it, and what it does,
    with the reason for the default; ``idle``: the setting that makes it ineffective here, empty where it acts."""

    name: str
    value: bool | int | float | str
    in_force: bool | int | float | str
    given: bool
    meaning: str
    idle: str = ""


@dataclasses.dataclass(frozen=True)
class EngineExplanation:
    """All that ``--explain`` says of an engine in addition to the decisions on features; ``copies``: shapes that are there more
    than once, beyond the first; ``explicit``: pairs of shapes that its files list."""

    engine: str
    pairs: tuple[PairExplained, ...]
    copies: int
    explicit: int
    settings: tuple[SettingExplained, ...]


def explained(world: World, compiled: Compiled) -> EngineExplanation:
    """The choices of the compiler for an engine; explicit pairs are counted in the files, by the format's reader."""
    engine = find_engine(compiled.engine)
    plan = contact_plan(world, engine.RULES, engine.LAYERS)
    layers = 1 + max(plan.layer_of.values(), default=0)
    listed = _listed(world, compiled)
    local = pair_settings(engine, world)
    pairs = []
    for pair, law in meeting_laws(world).items():
        layer, by_numbers = plan.layer_of.get(pair, 0), pair not in plan.missed
        how = _how(law, engine.RULES, plan, listed[pair], layer, layers)
        pairs.append(PairExplained(*pair, _law(law), how, by_numbers, listed[pair], layer, layers, local.get(pair, {})))
    used = {shape.material for body in world.bodies for shape in solid_shapes(body)}
    for law in world.contact.pairs:
        if not law.collide and {law.first, law.second} <= used:
            how = "collision filtered out"
            pairs.append(PairExplained(law.first, law.second, {"collide": False}, how, False, 0, 0, layers))
    copies = sum(len(plan.layers(shape.material)) - 1 for body in world.bodies for shape in solid_shapes(body))
    stated = dict(world.options(compiled.engine).settings)
    in_force = json.loads(compiled.files[SIDECAR])["settings"]
    resolved = resolve_settings(engine, world)
    idle = idle_settings(engine, resolved)
    settings = []
    for name, value in resolved.items():
        meaning, without = engine.SETTINGS[name].meaning, idle.get(name, "")
        settings.append(SettingExplained(name, value, in_force.get(name, value), name in stated, meaning, without))
    pairs.sort(key=lambda pair: (pair.first, pair.second))
    return EngineExplanation(compiled.engine, tuple(pairs), copies, sum(listed.values()), tuple(settings))


def _listed(world: World, compiled: Compiled) -> Counter[tuple[str, str]]:
    """How many pairs of shapes the files list, by the sorted names of their materials."""
    material = {shape.name: shape.material for body in world.bodies for shape in body.shapes}
    with scratch_folder("explain") as place:
        folder = place / compiled.engine
        write_folder(compiled.files, folder)
        pairs = dialects()[compiled.dialect].read(folder).pairs
    materials = (sorted((material[pair.first], material[pair.second])) for pair in pairs)
    return Counter((first, second) for first, second in materials)


def _law(law: PairContact) -> dict[str, Any]:
    """The numbers of a pair's law that are not zero."""
    numbers_of_law: dict[str, Any] = {name: getattr(law, name) for name in COMBINED_QUANTITIES if getattr(law, name)}
    numbers_of_law = numbers_of_law or {"friction": 0.0}
    if law.restitution_threshold:
        numbers_of_law["restitution_threshold"] = law.restitution_threshold
    if law.hardness != Hardness():
        numbers = {name: value for name, value in dataclasses.asdict(law.hardness).items() if name != "kind" and value}
        numbers_of_law["hardness"] = numbers or law.hardness.kind
    return numbers_of_law


def _how(law: PairContact, rules: Rules, plan: ContactPlan, listed: int, layer: int, layers: int) -> str:
    pair = (law.first, law.second)
    explicit = f"{listed} explicit pairs of shapes" if listed != 1 else "1 explicit pair of shapes"
    if pair in plan.missed:
        return f"{explicit}: not representable by material parameters"
    first, second = (plan.numbers[name, layer] for name in pair)
    numbers = [_numbers(name, rules, first, second) for name in COMBINED_QUANTITIES if getattr(law, name)] or [
        "no parameters needed"
    ]
    where = f"; in layer {layer + 1} of {layers}" if layers > 1 else ""
    return ", ".join(numbers) + where + (f"; and {explicit}, which override the material parameters" if listed else "")


def _numbers(quantity: str, rules: Rules, first: Surface, second: Surface) -> str:
    rule = SIGNS.get(getattr(rules, quantity), getattr(rules, quantity))
    a, b = getattr(first, quantity), getattr(second, quantity)
    numbers = f"{a:.4g} {rule} {b:.4g}" if rule in ("×", SIGNS["cross"]) else f"{rule}({a:.4g}, {b:.4g})"
    return f"{quantity.replace('_', ' ')} {numbers}"


def _part_words(name: str, value: Any) -> str:
    """One part of a law as a table writes it."""
    if name == "collide":
        return "no collision"
    if isinstance(value, dict):
        return ", ".join(_part_words(*part) for part in value.items())
    shown = f"{value:.4g}{UNITS.get(name, '')}" if isinstance(value, float) else str(value)
    return f"{name.replace('_', ' ')} {shown}"


def tables(world: World, compiled: Compiled) -> list[Table]:
    """Three tables of one engine: contact, features, solver settings."""
    explanation = explained(world, compiled)
    contact = Table(f"Contact in {explanation.engine}", "materials", "law", "realisation")
    for pair in explanation.pairs:
        law = ", ".join(_part_words(*part) for part in (pair.law | pair.settings).items())
        contact.add(f"{pair.first}, {pair.second}", law, pair.how)
    copies = f"realised by copies: {explanation.copies} additional shapes in layers; shapes touch only within a layer"
    explicit = f"{explanation.explicit} explicit pairs of shapes in all"
    contact.note = "; ".join([copies] * bool(explanation.copies) + [explicit] * bool(explanation.explicit))
    settings = Table(f"Solver of {explanation.engine}", "setting", "value", "from", "why")
    for setting in explanation.settings:
        same = setting.value == setting.in_force
        shown = str(setting.value) if same else f"{setting.value}: {setting.in_force}"
        source, why = "spec" if setting.given else "default", setting.meaning
        if setting.idle:
            shown, source, why = "–", "–", f"no effect {setting.idle}"
        settings.add(setting.name, shown, source, why)
    return [*([contact] if explanation.pairs else []), decisions(compiled), settings]


def control_table(world: World) -> Table:
    """The controllers of a world: joints, law and numbers, on the joints' side of any gear."""
    controllers = Table("Control", "controller", "joints", "law", "parameters, at the joints")
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    for controller in world.controllers:
        law = controller.law if controller.law == "native" else f"{controller.law}, {controller.discretisation}"
        controllers.add(controller.name, ", ".join(controller.joints), law, "; ".join(_figures(controller, kinds)))
    if any(controller.law == "native" for controller in world.controllers):
        controllers.note = "native: the engine's own controller, which differs between engines"
    return controllers


def forces_table(world: World) -> Table:
    """The forces on bodies of a world, in the world's axes."""
    forces = Table("Forces on bodies", "body", "force, N", "torque, N m", "at, in its frame, m", "from", "until")
    for force in world.forces:
        vectors = (" ".join(f"{value:.4g}" for value in vector) for vector in (force.force, force.torque, force.at))
        until = "the end" if force.until is None else f"{force.until:g} s"
        forces.add(force.body, *vectors, f"{force.start:g} s", until)
    forces.note = (
        "world axes; in each step the mean over the step, as efforts on the joints from the engine's own poses"
    )
    return forces


def _figures(controller: JointController, kinds: Mapping[str, str]) -> Iterator[str]:
    if controller.hold > 1:
        yield f"every {controller.hold} steps"
    if controller.law == "computed-torque":
        yield f"ω {controller.natural_frequency:g} rad/s, ζ {controller.damping_ratio:g}"
    if controller.gravity_compensation:
        yield "gravity compensation"
    numbers = (controller.kp, controller.kd, controller.effort_limits)
    for kind, units in GAINS.items():
        mine = [index for index, name in enumerate(controller.joints) if kinds[name] == kind]
        for (label, unit), values in zip(units.items(), numbers, strict=True):
            said = [value for index in mine if values and (value := values[index]) is not None]
            if said and (label == "effort" or any(said)):
                low, high = min(said), max(said)
                yield f"{label} {low:.4g} {unit}" if low == high else f"{label} {low:.4g} to {high:.4g} {unit}"


def ways(explanation: EngineExplanation) -> Mapping[str, int]:
    """How many pairs of materials are had in each way, for tests and summaries."""
    return Counter(
        "passing"
        if "collide" in pair.law
        else "explicit"
        if not pair.by_numbers
        else "layered"
        if pair.layers > 1
        else "numbers"
        for pair in explanation.pairs
    )


def decisions(compiled: Compiled) -> Table:
    """How each needed feature is realised in one engine."""
    features = Table(f"Features in {compiled.engine} ({compiled.format})", "feature", "support", "realisation", "where")
    for decision in compiled.decisions:
        more = f" (and {len(decision.paths) - 1} more)" if len(decision.paths) > 1 else ""
        features.add(decision.feature.value, WORDS[decision.level], decision.how, decision.paths[0] + more)
    return features


# ``simspec explain``: verdict, steps that led to it, and a table of all swaps.

MOST_ROWS = 12
"""Swaps in the table; the others are counted."""


def explanation_data(explanation: Explanation) -> dict[str, Any]:
    """The explanation as plain data, with its verdict."""
    data: dict[str, Any] = plain(explanation)
    return {"verdict": list(verdict(explanation)), **data}


def show_explanation(explanation: Explanation, notes: Sequence[str] = ()) -> None:
    """Print an explanation."""
    screen = console()
    for line in verdict(explanation):
        screen.note(line)
    screen.print("")
    screen.print(f"A: {explanation.first}", soft_wrap=True)
    screen.print(f"B: {explanation.second}", soft_wrap=True)
    for line in (*steps(explanation), *explanation.notes, *notes):
        screen.note(line)
    if explanation.causes or explanation.probes:
        screen.print(swaps_table(explanation))


def steps(explanation: Explanation) -> Iterator[str]:
    """The steps, one line each: models, smooth motion, what was given differently, windows, first contact."""
    yield from model_lines(explanation.models, explanation.same_world, "; --verify proves it")
    given = [swap.name for swap in explanation.causes]
    yield f"given differently: {', '.join(given) if given else 'nothing'}"
    looked = sum(explanation.counts.values())
    sample = f", {explanation.looked_at} looked at" if explanation.looked_at < looked else ""
    sample += f", {explanation.hidden} left out, in which noise hides the gap" if explanation.hidden else ""
    yield f"windows: {looked} of {explanation.length:g} s, all from A's states{sample}"
    for name in (*CLASSES, RUN):
        if name in explanation.gap:
            yield f"  {_gap(explanation, name)}"
    contact = explanation.contact
    if contact is None:
        touches = any(explanation.counts[name] for name in ("impact", "contact"))
        yield "first contact: not comparable" if touches else "first contact: none in A's run"
        return
    text = f"first contact: {' and '.join(contact.bodies)}, both from A's state before it"
    yield f"{text}: {contact.differs or 'nothing'} differs first"
    units = {"depth": (1e6, " µm"), "normal force": (1.0, " N"), "points": (1.0, "")}
    for name, values in contact.quantities.items():
        factor, unit = units[name]
        entry, other = ("no contact" if value is None else f"{value * factor:.5g}{unit}" for value in values)
        yield f"  {name}: {entry} in A, {other} in B"


def _gap(explanation: Explanation, name: str) -> str:
    count = explanation.counts.get(name)
    gap, floor = explanation.gap[name], explanation.floor.get(name, 0.0)
    words = f"{CLASS_WORDS[name]} ({count})" if count is not None else CLASS_WORDS[name]
    same = "" if name in explanation.telling else ": the same, to round-off"
    return f"{words}: mean gap {gap:.3g} m, noise {floor:.2g} m{same}"


def swaps_table(explanation: Explanation) -> Table:
    """The swaps with their shares by class, the largest first; probes that close nothing are counted."""
    classes = [name for name in explanation.telling if name != ALL] + ([ALL] if ALL in explanation.telling else [])
    kinds = (explanation.causes, explanation.probes)
    title = "swaps: one thing changed, and the share of the gap that it closes"
    right = range(3, 3 + len(classes))
    shown = Table(title, "change", "from", "to", *(CLASS_WORDS[name] for name in classes), right=list(right))
    for declared in explanation.declared:
        if declared.predicted:
            cells = ["" if name not in declared.share else percent(declared.share[name]) for name in classes]
            shown.add(f"{declared.acts}, as declared", declared.engine, "predicted", *cells)
    ordered = (sorted(swaps, key=lambda swap: (swap.failed is not None, -swap.largest)) for swaps in kinds)
    every = [swap for of_kind in ordered for swap in of_kind]
    idle = [swap for swap in explanation.probes if not swap.share and swap.failed is None] if classes else []
    swaps = [swap for swap in every if all(swap is not other for other in idle)]
    if any(share < 0.0 for swap in swaps[:MOST_ROWS] for share in swap.share.values()):
        shown.note = "negative: the gap grows by this share with the change"
    for swap in swaps[:MOST_ROWS]:
        cells = ["" if name not in swap.share else percent(swap.share[name]) for name in classes]
        if swap.failed is not None:
            cells = ["not possible"] + [""] * (len(classes) - 1) if classes else []
        elif not swap.share and classes:
            cells[0] = "none"
        before, after = swap.values if swap.kind != CandidateKind.DIFFERENCE.value else swap.values[::-1]
        shown.add(swap.name, before, after, *cells)
    if idle:
        counted = f"{len(idle)} other {'change' if len(idle) == 1 else 'changes'} (--json)"
        shown.add(counted, "", "", *["none"][: len(classes)], *[""] * (len(classes) - 1))
    if len(swaps) > MOST_ROWS:
        shown.add(f"and {len(swaps) - MOST_ROWS} more (--json)", "", "", *[""] * len(classes))
    return shown


# Explanations in studies: differences of each engine from the first, with their causes (``docs/guide/explain.md``).

MOST = 3
"""Causes, and other choices, that the table names of an engine; the records have all."""
TITLE = "Where each engine differs from the first, within windows"
CAUSES = "Shares of that difference that single values or choices close"
NOTE = (
    "Both engines begin each window in the first one's states. Gap: mean distance at its end, over all bodies; unexplained: "
    "the share that no value, setting or choice closes"
)


def attribution_tables(done: Done) -> list[StudyTable]:
    """``attribution`` and ``attribution.causes``."""
    gap_classes = {name for entry in done.explained if entry.found is not None for name in entry.found.gap}
    classes = [name for name in (*CLASSES, RUN) if name in gap_classes]
    heads = [f"gap, {CLASS_WORDS[name]}" for name in classes]
    right = range(1, 1 + len(heads))
    gaps = StudyTable(done, "attribution", TITLE, "engine", *heads, "unexplained", right=right)
    causes = StudyTable(done, "attribution.causes", CAUSES, "engine", "what", "from", "to", "closes")
    for entry in done.explained:
        found = entry.found
        if found is None:
            record: dict[str, Any] = {"engine": entry.engine, "first": entry.first, "refused": entry.refused}
            gaps.add(entry.engine, *(["–"] * len(heads)), TableCell(entry.refused, DIM), record=record)
            continue
        known = {name: f"{gap:.2g} m" if name in found.telling else "the same" for name, gap in found.gap.items()}
        cells = [known.get(name, "–") for name in classes]
        left = {name: share for name, share in found.unexplained.items() if name in (*CLASSES, RUN)}
        unexplained = ", ".join(f"{percent(max(share, 0.0))} {CLASS_WORDS[name]}" for name, share in left.items())
        record = {"engine": entry.engine, "first": entry.first, "windows": found.looked_at, "length": found.length}
        record |= {f"gap.{name}": finite(value) for name, value in found.gap.items()}
        record |= {f"unexplained.{name}": finite(value) for name, value in left.items()}
        gaps.add(entry.engine, *cells, unexplained or "nothing to explain", record=record)
        for swap in _ranked_swaps(found.causes, found.probes):
            before, after = swap.values
            record = {"engine": entry.engine, "first": entry.first, "what": swap.name, "from": before, "to": after}
            record |= {"kind": swap.kind} | {f"share.{name}": finite(share) for name, share in swap.share.items()}
            closed = {name: share for name, share in swap.share.items() if name in (*CLASSES, RUN)}
            words = [f"{ranged(share, swap.interval.get(name))} {CLASS_WORDS[name]}" for name, share in closed.items()]
            causes.add(entry.engine, swap.name, before, after, ", ".join(words) or "none", record=record)
        gaps.said += tuple(f"{entry.engine} beside {entry.first}: {line}" for line in verdict(found)[:MOST])
    gaps.note = NOTE
    return [gaps, causes]


def _ranked_swaps(causes: tuple[Swap, ...], probes: tuple[Swap, ...]) -> list[Swap]:
    """The differences that act, the engines' other choices that help, and the parts without which nothing differs; of
    each the largest first."""
    ranked = sorted(useful(probes), key=lambda swap: -swap.largest)
    chosen = [swap for swap in ranked if swap.kind != CandidateKind.REMOVAL.value]
    places = [swap for swap in ranked if swap.kind == CandidateKind.REMOVAL.value]
    return [*acting(causes)[:MOST], *chosen[:MOST], *places[:MOST]]
