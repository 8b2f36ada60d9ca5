"""XML files as elements: lines and texts kept, everything that leads out of the file or out of bounds refused with its line."""

from __future__ import annotations

import os
from pathlib import Path
from xml.sax.saxutils import escape

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.formats.kit import text as xml_elements
from simspec.formats.kit.text import parse_xml, read_xml

XML = (".xml", ".skel", ".urdf", ".sdf")
GENERATED = Path(__file__).resolve().parents[3] / "generated"
COMPILED = [path for name in ("spheres-216", "ur10e", "gripper-lift") for path in sorted((GENERATED / name).rglob("*"))]
"""Files of the library; of those that are XML each is read in several ways."""


def test_elements_keep_order_lines_attributes_and_texts():
    root = parse_xml(b"<a>\n  one\n  <b x='1' y='&lt;&#34;'/>\n  two <c\n  z='2'>\n<b/></c>\n</a>\n", "f.xml")
    assert [(element.tag, element.line) for element in root.walk()] == [("a", 1), ("b", 3), ("c", 4), ("b", 6)]
    assert root.text == "one two"
    assert root.children[0].attributes == {"x": "1", "y": '<"'}
    assert [element.line for element in root.all("b")] == [3]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_declared_encodings_are_read(encoding):
    text = f"<?xml version='1.0' encoding='{encoding}'?><a name='é'/>"
    assert parse_xml(text.encode(encoding), "f.xml").attributes == {"name": "é"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"f\.xml:1: no element found"),
        (b"<a>\n<b>\n", r"f\.xml:3: no element found"),
        (b"<a>\n</b>", r"f\.xml:2: mismatched tag"),
        (b"<a/>\n<b/>", r"f\.xml:2: junk after document element"),
        (b"<a x='1' x='2'/>", "duplicate attribute"),
        (b"<a>&other;</a>", "undefined entity"),
        (b"\n<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", r"f\.xml:\d: a document type"),
        (b"<!DOCTYPE a SYSTEM 'file:///etc/hostname'><a/>", "a document type"),
        (b"<?xml version='1.0' encoding='utf-7'?><a/>", r"f\.xml:1: multi-byte"),
        (b"<?xml version='1.0' encoding='zlib_codec'?><a/>", r"f\.xml:1: "),
        (b"<?xml version='1.0' encoding='none-such'?><a/>", r"f\.xml:1: unknown encoding"),
        (bytes(range(256)), r"f\.xml:1: not well-formed"),
        (b"<a x='\0'/>", r"f\.xml:1: not well-formed"),
        (b"<a " + b" ".join(b"x%d=''" % number for number in range(300)) + b"/>", "more than 256 attributes"),
    ],
)
def test_malformed_xml_is_rejected_with_its_line(content, message):
    with pytest.raises(ValueError, match=message):
        parse_xml(content, "f.xml")


@pytest.mark.parametrize(
    ("bound", "value", "content", "message"),
    [
        ("MOST_ELEMENTS", 10, b"<a>" + b"<b/>" * 10 + b"</a>", "more than 10 elements"),
        ("MOST_DEPTH", 10, b"<a>" * 11 + b"</a>" * 11, "more than 10 elements in one another"),
        ("LONGEST_TAG", 2**12, b"<a x='" + b"1" * 2**14 + b"'/>", "a tag of more than 4,096 bytes"),
    ],
)
def test_bounds_hold(monkeypatch, bound, value, content, message):
    monkeypatch.setattr(xml_elements, "CHUNK", 2**10)
    assert parse_xml(content, "f.xml").tag == "a"
    monkeypatch.setattr(xml_elements, bound, value)
    with pytest.raises(ValueError, match=message):
        parse_xml(content, "f.xml")


def test_a_chain_as_deep_as_the_bound_is_read_and_walked():
    root = parse_xml(b"<a>" * 20_000 + b"</a>" * 20_000, "f.xml")
    assert sum(1 for _ in root.walk()) == 20_000


def test_only_regular_files_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "real.xml").write_text("<a/>")
    (tmp_path / "link.xml").symlink_to(tmp_path / "real.xml")
    assert read_xml(tmp_path / "real.xml").tag == "a"
    for name in ("pipe.xml", "link.xml"):
        with pytest.raises(SpecError, match=name):
            read_xml(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        read_xml(tmp_path / "none.xml")


TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\r", exclude_categories=("Cc", "Cs")), max_size=60)
"""Any text that XML 1.0 can say, but for the ends of lines, which every parser normalises."""
FORMS = ("escaped", "decimal", "hexadecimal", "cdata", "comment", "instruction")


def in_form(text: str, form: str) -> str:
    """A piece of a text as XML may write it."""
    if form == "decimal":
        return "".join(f"&#{ord(name)};" for name in text)
    if form == "hexadecimal":
        return "".join(f"&#x{ord(name):x};" for name in text)
    if form == "cdata" and "]]>" not in text:
        return f"<![CDATA[{text}]]>"
    between = {"comment": "<!-- 7 -->", "instruction": "<?say 7?>"}.get(form, "")
    return escape(text) + between


def valid(text: str) -> bool:
    return not any(ord(name) in (0xFFFE, 0xFFFF) for name in text)


@given(
    pieces=st.lists(st.tuples(TEXTS.filter(valid), st.sampled_from(FORMS)), min_size=1, max_size=8),
    before=st.integers(0, 40),
    chunk=st.integers(1, 50),
)
def test_a_text_is_independent_of_chunks_and_of_the_way_it_is_written(pieces, before, chunk):
    content = f"<a>{' ' * before}<b>{''.join(in_form(*piece) for piece in pieces)}</b><c/>tail</a>".encode()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xml_elements, "CHUNK", chunk)
        root = parse_xml(content, "f.xml")
    assert root.children[0].text == "".join(text for text, _ in pieces).strip()
    assert root.text == "tail"


@pytest.mark.parametrize("place", [*range(2**20 - 24, 2**20 + 2), *range(2**13 - 24, 2**13 + 2)])
def test_a_number_across_the_end_of_a_chunk_is_read_whole(place):
    """Of the true chunk, and of the buffer in which the parser collects texts."""
    before = "<a><b>"
    root = parse_xml(f"{before}{' ' * (place - len(before))}0.8400000000001</b></a>".encode(), "f.xml")
    assert root.children[0].text == "0.8400000000001"


def test_child_elements_divide_a_text():
    root = parse_xml(b"<a>0.84<b/>01<!-- c -->2<b/> <b/>3</a>", "f.xml")
    assert root.text == "0.84 012 3"


def said(root):
    """All of a document."""
    return [(entry.tag, entry.line, dict(entry.attributes), entry.text, len(entry.children)) for entry in root.walk()]


@pytest.mark.parametrize("path", [path for path in COMPILED if path.suffix in XML], ids=str)
def test_a_compiled_file_is_the_same_in_chunks_of_any_size(path, monkeypatch):
    content = path.read_bytes()
    whole = said(parse_xml(content, path.name))
    assert len(whole) > 3
    for chunk in (61, 1009, 8191):
        monkeypatch.setattr(xml_elements, "CHUNK", chunk)
        assert said(parse_xml(content, path.name)) == whole
