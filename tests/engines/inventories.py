"""The inventory of an engine, compared with the expectation of the world."""

from __future__ import annotations

from simspec.engines.kit.contract import Engine
from simspec.proof.checks import Check, inventory_checks
from simspec.world.types import World


def inventory_check(world: World, engine: Engine) -> Check:
    """The proof's check of an inventory, for an engine that is loaded in this process."""
    back = engine.read_back()
    (check,) = inventory_checks(type(engine).expected_inventory(world, back.neutral), back.inventory)
    return check
