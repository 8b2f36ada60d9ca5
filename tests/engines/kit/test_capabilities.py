"""An engine has each capability, or declares why it lacks it; a missing capability raises that reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from simspec.contact import Rules
from simspec.engines.kit.capabilities import MEANING, METHODS, Capability, Lacking, NativeLaw, ServoLaw
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines
from simspec.errors import EngineError
from simspec.report import matrix
from simspec.support.declarations import EXACT, never
from simspec.support.features import Feature

ALL = dict.fromkeys(Capability, "only falls")
DECLARED: dict[str, Any] = {
    "NAME": "falling",
    "DIALECT": "none",
    "DISTRIBUTION": "numpy",
    "EXTRA": "none",
    "RULES": Rules("max", "max"),
    "LAYERS": False,
    "SETTINGS": {},
    "SUPPORT": dict.fromkeys(Feature, EXACT) | {Feature.CONTROL_NATIVE: never("only falls")},
}


def make(lacks: dict[Any, str], parent: type[Engine] = Engine, **more: Any) -> type[Engine]:
    return type("Falling", (parent,), DECLARED | {"LACKS": lacks} | more)


def without(*capabilities: Capability) -> dict[Capability, str]:
    return {capability: reason for capability, reason in ALL.items() if capability not in capabilities}


def test_every_capability_has_a_meaning_and_methods_of_the_contract():
    assert list(MEANING) == list(METHODS) == list(Capability)
    for methods in METHODS.values():
        assert methods
        assert all(hasattr(Engine, method) for method in methods)


@pytest.mark.parametrize("capability", Capability)
def test_a_missing_capability_raises_the_declared_reason(capability):
    engine = make(ALL)()
    for method in METHODS[capability]:
        with pytest.raises(EngineError, match=f"falling: does not support {capability}: only falls"):
            getattr(engine, method)(1, 2, 3)


def test_a_derived_capability_raises_the_same_reason():
    class static(make(ALL)):
        def get_state(self):
            return [0.0], [0.0]

    with pytest.raises(EngineError, match="does not support mass_matrix: only falls"):
        static().mass_matrix()
    with pytest.raises(EngineError, match="does not support pair_detection: only falls"):
        static().detect_contacts()


@pytest.mark.parametrize("capability", Capability)
def test_an_engine_that_declares_nothing_lacking_defines_the_methods(capability):
    for missing in METHODS[capability]:
        rest = {method: lambda self: None for method in METHODS[capability] if method != missing}
        with pytest.raises(TypeError, match=f"must define {missing}, or say in LACKS why it has no {capability}"):
            make(without(capability), **rest)


@pytest.mark.parametrize("capability", [entry for entry in Capability if entry is not Capability.NATIVE_CONTROLLERS])
def test_an_engine_cannot_define_capabilities_that_it_declares_as_lacking(capability):
    with pytest.raises(TypeError, match=f"declares that it lacks {capability}, and defines {METHODS[capability][0]}"):
        make(ALL, **{METHODS[capability][0]: lambda self: None})


@pytest.mark.parametrize("lacks", [{"magic": "why"}, {Capability.ENERGY: " "}, {"energy!": ""}])
def test_a_declaration_names_a_capability_and_a_reason(lacks):
    with pytest.raises(TypeError, match=r"unknown capabilities \['(magic|energy!)'\]|no reason for energy"):
        make(lacks)


def test_native_controllers_and_control_native_go_together():
    with pytest.raises(TypeError, match=r"lacks native controllers, but declares support for control\.native"):
        make(ALL, SUPPORT=dict.fromkeys(Feature, EXACT))


def test_engines_with_native_controllers_declare_their_law():
    with pytest.raises(TypeError, match="must declare NATIVE_LAW exactly where it has native controllers"):
        make(without(Capability.NATIVE_CONTROLLERS), track=lambda self: None)
    with pytest.raises(TypeError, match="must declare NATIVE_LAW exactly where it has native controllers"):
        make(ALL, NATIVE_LAW=NativeLaw(ServoLaw.MOTOR, accuracy=1e-9))
    law = NativeLaw(ServoLaw.IMPLICIT_SPRING, accuracy=1e-9)
    engine = make(without(Capability.NATIVE_CONTROLLERS), track=lambda self: None, NATIVE_LAW=law)
    assert engine.NATIVE_LAW is law


def test_a_subclass_may_drop_and_restore_capabilities_of_its_parent():
    able = make(without(Capability.ENERGY), energy=lambda self: (1.0, 2.0))
    assert able().energy() == (1.0, 2.0)
    unable = make(ALL, able)
    with pytest.raises(EngineError, match="does not support energy"):
        unable().energy()
    with pytest.raises(TypeError, match="must define energy"):
        make(without(Capability.ENERGY), unable)
    assert make(without(Capability.ENERGY), unable, energy=lambda self: (3.0, 4.0))().energy() == (3.0, 4.0)


def test_an_external_program_defines_no_methods():
    engine = make(without(Capability.ENERGY), command=classmethod(lambda cls, folder: [str(Path(folder))]))
    assert Capability.ENERGY not in engine.LACKS


def test_a_shared_base_class_declares_nothing():
    class Common(Engine, abstract=True):
        def energy(self):
            return 5.0, 6.0

    assert make(without(Capability.ENERGY), Common)().energy() == (5.0, 6.0)


@pytest.mark.parametrize("name", engines())
def test_the_engines_of_simspec_declare_missing_capabilities(name):
    engine = engines()[name]
    for capability, methods in METHODS.items():
        for method in methods:
            var = next(vars(parent)[method] for parent in engine.__mro__ if method in vars(parent))
            assert isinstance(var, Lacking) == (capability in engine.LACKS)


def test_the_matrix_shows_them_with_their_reasons():
    page, data = matrix.markdown(), matrix.engine_data()
    for name, engine in engines().items():
        assert data[name]["capabilities"] == {
            capability.value: capability not in engine.LACKS for capability in Capability
        }
        for capability, reason in engine.LACKS.items():
            assert data[name]["lacks"][capability.value] == reason
            (note,) = [line for line in page.splitlines() if line.startswith("- [c") and f"] {reason} (" in line]
            users = note.rsplit(" (", 1)[1].rstrip(")").split("; ")
            (features,) = [user for user in users if user.startswith(f"{name}: ")]
            assert f"`{capability}`" in features


def test_the_page_about_adding_an_engine_lists_them():
    page = (Path(__file__).parents[3] / "docs" / "design" / "adding-an-engine.md").read_text(encoding="utf-8")
    for capability, methods in METHODS.items():
        assert f"| `{capability}` | {', '.join(f'`{method}`' for method in methods)}" in page
