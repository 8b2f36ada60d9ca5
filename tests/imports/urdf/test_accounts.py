"""Every element of a file is accounted for: nothing that is put into it at random passes unseen."""

from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from simspec.errors import SpecError
from simspec.imports.elements import Element, parse
from simspec.imports.files import Files
from simspec.imports.urdf.importer import UrdfImporter
from simspec.language.foreign import Fate, ImportOptions
from tests.imports.urdf.robots import SPECIMEN

WORDS = st.from_regex(r"\A[a-z]{1,8}\Z")
OF_URDF = st.sampled_from(
    ("origin", "mass", "limit", "mimic", "axis", "geometry", "material", "inertial", "dynamics", "name")
)


def accounts(text: str):
    files = Files.__new__(Files)
    files.shown, files.options, files.read = "r.urdf", ImportOptions(), {}
    return UrdfImporter().parsed(text.encode(), files).accounts


BEFORE = Counter((account.what, account.fate) for account in accounts(SPECIMEN))
ELEMENTS = sum(1 for _ in etree.fromstring(SPECIMEN.encode()).iter(etree.Element))


@settings(max_examples=250, deadline=None)
@given(st.integers(0, ELEMENTS - 1), st.booleans(), WORDS | OF_URDF, st.sampled_from(("", "1", "0.5 0 0", "x")))
def test_random_insertions_are_reported(index, is_attribute, word, value):
    """An unknown attribute or element, or a known one where it is not expected, is lost and says so; or it is reported with
    what it stands in, or refused."""
    root = etree.fromstring(SPECIMEN.encode())
    place = list(root.iter(etree.Element))[index]
    if is_attribute:
        if word in place.attrib:
            return
        place.set(word, value)
    else:
        etree.SubElement(place, word).set("note", value)
    try:
        after = accounts(etree.tostring(root, encoding="unicode"))
    except SpecError:
        return
    chain = [place, *place.iterancestors()]
    inside_of_what_is_set_aside = {
        account.what.split("/")[-1].split("[")[0] for account in after if account.fate is not Fate.CARRIED
    } & {element.tag for element in chain}
    new = Counter((account.what, account.fate) for account in after) - BEFORE
    assert new or inside_of_what_is_set_aside, etree.tostring(place)


def walk(element: Element):
    yield element
    for child in element.look():
        yield from walk(child)


def test_every_element_and_attribute_is_reported_or_stands_in_a_reported_element():
    paths = {account.what for account in accounts(SPECIMEN)}
    lost = {account.what for account in accounts(SPECIMEN) if account.fate is not Fate.CARRIED}
    for element in walk(parse(SPECIMEN.encode(), "r.urdf")):
        above, here = [], element
        while here is not None:
            above.append(here.path)
            here = here.parent
        for what in (element.path, *(f"{element.path}/@{name}" for name in element.attributes)):
            assert what in paths or lost & set(above), what
