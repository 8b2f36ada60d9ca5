"""From the law of every two materials to the numbers that an engine's shapes hold.

Most engines have no table of pairs: they combine two shapes' numbers by a rule of their own (``rules.Rules``). The plan inverts
that rule (``inversion``). Where one number for each material cannot give all pairs, there are two ways, and an engine's module
says which it has:

- *layers*: a shape is there several times, once in each layer that its material takes part in, and two copies meet only
  in the layer that their pair of materials belongs to. Each layer has numbers of its own;
- *explicit pairs*: the engine takes the law of two shapes as such; only pairs that numbers cannot give are written.

One that holds a table by materials (rule ``table``) needs neither: its shapes have no numbers, and its dialect writes the laws.
Each way is chosen by data (``Target.plan``), and its cost is what ``simspec compile --explain`` shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from simspec.contact.inversion import invert
from simspec.contact.rules import Rules, combine, same
from simspec.language.vocabulary import COMBINED_QUANTITIES
from simspec.world.canonical import derived
from simspec.world.contact_pairs import Pair, meeting_laws
from simspec.world.types import PairContact, Surface, World

MOST_SPLIT_MATERIALS = 32
"""Materials among which layers are sought: their number of tries grows with the fourth power."""


@dataclass(frozen=True)
class ContactPlan:
    """How one world's pairs are had in one engine.

    numbers    for each (material, layer) what its shapes hold there
    layer_of   for each pair of materials that meet and collide, sorted, the layer in which they meet
    missed     pairs of which some number is not what the rules give in their layer, sorted: left to explicit pairs, or
               not to be had
    explicit   the pairs to be written as explicit ones, in the plan of a contact probe, which has what its scenario's files
               have; None: the format decides
    """

    numbers: Mapping[tuple[str, int], Surface]
    layer_of: Mapping[Pair, int]
    missed: tuple[Pair, ...] = ()
    explicit: tuple[Pair, ...] | None = None

    def layers(self, material: str) -> tuple[int, ...]:
        """The layers that the shapes of a material are in, at least one."""
        return tuple(sorted(layer for name, layer in self.numbers if name == material))

    @property
    def layered(self) -> bool:
        """Whether some shape is there more than once."""
        return len(self.numbers) > len({name for name, _ in self.numbers})

    def meet(self, first: tuple[str, int], second: tuple[str, int]) -> bool:
        """Whether copies of (material, layer) and (material, layer) touch."""
        pair = (min(first[0], second[0]), max(first[0], second[0]))
        return first[1] == second[1] == self.layer_of.get(pair, -1)


@derived
def contact_plan(world: World, rules: Rules, layers: bool) -> ContactPlan:
    """The plan of ``world`` under an engine's ``rules``; in several ``layers`` where one does not do and they are allowed."""
    wanted = meeting_laws(world)
    materials = [material.name for material in world.contact.materials]
    numbers = invert(world, rules, wanted)
    missed = missed_pairs(rules, wanted, numbers)
    if not missed or not layers or len({name for pair in wanted for name in pair}) > MOST_SPLIT_MATERIALS:
        return ContactPlan({(name, 0): numbers[name] for name in materials}, dict.fromkeys(wanted, 0), missed)
    return _in_layers(world, rules, wanted)


def _in_layers(world: World, rules: Rules, wanted: Mapping[Pair, PairContact]) -> ContactPlan:
    """Each pair goes into the first layer that takes it; what no layer takes alone cannot be had."""
    layers: list[dict[Pair, PairContact]] = []
    missed = []
    for pair, law in wanted.items():
        for layer in [*layers, {}]:
            trial = {**layer, pair: law}
            if not missed_pairs(rules, trial, invert(world, rules, trial)):
                if not layer:
                    layers.append(layer)
                layer[pair] = law
                break
        else:
            missed.append(pair)
    if missed:
        layers = layers or [{}]
        layers[0].update({pair: wanted[pair] for pair in missed})
    numbers: dict[tuple[str, int], Surface] = {}
    for index, layer in enumerate(layers):
        found = invert(world, rules, layer)
        used = {name for pair in layer for name in pair}
        numbers.update({(name, index): found[name] for name in found if name in used})
    everywhere = invert(world, rules, {})
    for material in world.contact.materials:  # what never meets anything is there all the same
        if not any(name == material.name for name, _ in numbers):
            numbers[material.name, 0] = everywhere[material.name]
    layer_of = {pair: index for index, layer in enumerate(layers) for pair in layer}
    return ContactPlan(dict(sorted(numbers.items())), layer_of, tuple(sorted(missed)))


def missed_pairs(rules: Rules, wanted: Mapping[Pair, PairContact], numbers: Mapping[str, Surface]) -> tuple[Pair, ...]:
    found = []
    for pair, law in wanted.items():
        given = combine(rules, numbers[pair[0]], numbers[pair[1]])
        if any(rules.combines(name) and not same(given[name], getattr(law, name)) for name in COMBINED_QUANTITIES) or (
            rules.hardness == "same" and any(numbers[name].hardness != law.hardness for name in pair)
        ):
            found.append(pair)
    return tuple(sorted(found))
