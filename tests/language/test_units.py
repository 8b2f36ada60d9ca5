"""Units: exact conversion, dimensions, and what is refused."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from itertools import product
from pathlib import Path

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.language import quantities
from simspec.language.quantities import DIMENSIONS, LARGEST, UnitError, parse, unit_names


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("5 mm", "length", 0.005),
        ("5mm", "length", 0.005),
        ("0.1 mm", "length", 1e-4),
        ("1 ms", "time", 0.001),
        ("90 deg", "angle", math.pi / 2),
        ("30 deg", "angle", math.pi / 6),
        ("-180 °", "angle", -math.pi),
        ("1 turn", "angle", 2 * math.pi),
        ("60 rpm", "angular velocity", 2 * math.pi),
        ("7.85 g/cm^3", "density", 7850.0),
        ("1 kg/m³", "density", 1.0),
        ("1 %", "number", 0.01),
        ("250", "mass", 250.0),
        ("1e-3 t", "mass", 1.0),
        ("3.5 N m", "torque", 3.5),
        ("2 N*m*s/rad", "angular damping", 2.0),
        ("2 N m s", "angular damping", 2.0),
        ("4 N m/rad", "angular stiffness", 4.0),
        ("4 N/mm", "stiffness", 4000.0),
        ("1 lbf", "force", 0.45359237 * 9.80665),
        ("1 ft", "length", 0.3048),
        ("3 µm", "length", 3e-6),
        ("10 m/s/s", "acceleration", 10.0),
        ("36 km/h", "velocity", 10.0),
        ("2 g*cm**2", "moment of inertia", 2e-7),
    ],
)
def test_value(text, dimension, value):
    assert parse(text, dimension) == value


@pytest.mark.parametrize(
    ("text", "dimension", "message"),
    [
        ("3 deg", "mass", "wrong unit: expected a mass (kg), found 'deg'"),
        ("1 %", "angle", "wrong unit"),
        ("1 rad", "number", "wrong unit"),
        ("1 kg", "length", "wrong unit"),
        ("1 N", "torque", "wrong unit"),
        ("1/s", "number", "wrong unit"),
        ("3 lightyears", "length", "unknown unit"),
        ("3 m//s", "velocity", "unknown unit"),
        ("3 m*", "length", "unknown unit"),
        ("*3 m", "length", "found no number"),
        ("3 (m", "length", "unknown unit"),
        ("nan", "length", "found no number"),
        ("inf m", "length", "found no number"),
        ("1e31", "length", "too large"),
        ("1e999 m", "length", "too large"),
        ("9**9**9**9 m", "length", "unknown unit"),
        ("1 m^99999999", "length", "unknown unit"),
        ("1 __import__", "length", "unknown unit"),
        ("1" * 100_000, "length", "found no number"),
        ("", "length", "found no number"),
        ("yes", "time", "found no number"),
    ],
)
def test_refused(text, dimension, message):
    with pytest.raises(UnitError, match=message.replace("(", r"\(").replace(")", r"\)")) as error:
        parse(text, dimension)
    assert len(error.value.found) < 120
    assert error.value.allowed


def test_a_misspelt_unit_is_suggested():
    with pytest.raises(UnitError) as error:
        parse("3 secnds", "time")
    assert "second" in error.value.hint


@given(st.decimals(min_value=-1000, max_value=1000, places=6))
def test_millimetres_are_rounded_once(number):
    """The nearest double to the exact product: dividing the double by 1000 would round twice."""
    exact = Fraction(number) / 1000
    found = parse(f"{number} mm", "length")
    assert abs(Fraction(found) - exact) <= min(
        abs(Fraction(math.nextafter(found, side)) - exact) for side in (math.inf, -math.inf)
    )


@pytest.mark.parametrize("name", unit_names())
def test_every_unit_fits_exactly_the_dimensions_of_its_name(name):
    """Each unit is of some dimension, or refused for its dimension by all, but never unknown."""
    fits, reasons = [], []
    for dimension in DIMENSIONS:
        try:
            fits.append(parse(f"1 {name}", dimension))
        except UnitError as error:
            reasons.append(str(error))
    assert all("wrong unit" in reason for reason in reasons)
    assert len(set(fits)) <= 1
    assert all(0 < value < LARGEST for value in fits)


def test_units_are_those_of_pint():
    """Names, prefixes and plurals are accepted as pint accepts them, with the same exact factors; but symbols have no plural
    (``lbs``, ``kgs``)."""
    definitions = (Path(__file__).parent / "data/units.txt").read_text().splitlines()
    registry = pint.UnitRegistry(None, non_int_type=Fraction)
    registry.load_definitions(definitions)
    prefixes = ["", *re.findall(r"\b([A-Za-z]+)-", "\n".join(definitions))]
    assert set(prefixes) == set(quantities._PREFIXES)
    words = {f"{prefix}{name}{end}" for prefix, name, end in product(prefixes, unit_names(), ("", "s", "ss"))}
    long = {name for name in unit_names() if len(name) > quantities.LONGEST_SYMBOL}
    plural_symbols = {f"{prefix}{name}s" for prefix, name in product(prefixes, {*unit_names()} - long)}
    plural_symbols -= {f"{prefix}{name}{end}" for prefix, name, end in product(prefixes, long, ("", "s"))}
    plural_symbols -= {f"{prefix}{name}" for prefix, name in product(prefixes, unit_names())}
    assert {"lbs", "kgs", "degs", "mms"} <= plural_symbols
    words |= {f"{prefix}{letter}" for prefix, letter in product(prefixes, "abcdefghijklmnopqrstuvwxyz_sS")} - {""}
    for word in sorted({*words, "dimensionless", "per", "sq", "pi", "e", "nan", "inf", "True", "yocto", "delta_m"}):
        if word == "dimensionless":  # pint's own name
            assert quantities._unit(word) == (1, (0, 0, 0, 0))
        elif word in registry._units:
            assert quantities._unit(word) == _of_pint(registry, "", word)
        elif not (found := registry.parse_unit_name(word)) or word in plural_symbols:
            with pytest.raises(ValueError, match=f"^{word}$"):
                quantities._unit(word)
        else:
            assert quantities._unit(word) == _of_pint(registry, *found[0][:2]), word


def _of_pint(registry, prefix, name):
    factor, base = registry.get_root_units(name)
    scale = registry._prefixes[prefix].value if prefix else 1
    powers = tuple(int(base._units.get(unit, 0)) for unit in ("metre", "kilogram", "second", "radian"))
    return Fraction(factor) * Fraction(scale), powers
