"""Parcels that travel to another machine and back: they return unchanged, and any other content is refused with a reason."""

from __future__ import annotations

import io
import json
import pickle
import random
import zlib

import pytest

from simspec.experiments import remote
from simspec.experiments.remote import LENGTH, MARK, Parcel, ParcelError, result_data, result_from
from simspec.experiments.store import result_of
from tests.runner.synthetic import free_body, run, world

WORLD = world(free_body("ball"))
KEY = "5" * 64
FACTS = {"numbers": [1, 2.5, -0.0, 1e-308], "text": "ä\n\0", "none": None, "nested": {"a": [{}]}}
CONTENTS = {"empty": b"", "zeros": bytes(100_000), "bytes": bytes(range(256))}


def packed(facts=FACTS, contents=CONTENTS, compress=False) -> bytes:
    return Parcel(facts, contents).pack(compress)


def forged(head, rest: bytes = b"") -> bytes:
    """A parcel with a head of one's own."""
    encode = head if isinstance(head, bytes) else json.dumps(head).encode()
    return MARK + len(encode).to_bytes(LENGTH, "big") + encode + rest


def head(**changes):
    return {"facts": {}, "contents": [], "compressed": False, **changes}


@pytest.mark.parametrize("compress", [False, True])
def test_it_comes_back_as_it_was(compress):
    again = Parcel.unpack(packed(compress=compress))
    assert again.facts == FACTS
    assert again.contents == CONTENTS
    assert Parcel.unpack(packed({}, {}, compress)) == Parcel({}, {})


def test_compressing_makes_it_small():
    assert len(packed(compress=True)) < 0.02 * len(packed())


@pytest.mark.parametrize("compress", [False, True])
def test_every_truncation_and_extension_is_refused(compress):
    whole = packed(FACTS, {"first": b"abc" * 20, "second": bytes(range(50))}, compress)
    for size in range(len(whole)):
        with pytest.raises(ParcelError):
            Parcel.unpack(whole[:size])
    with pytest.raises(ParcelError, match="another length"):
        Parcel.unpack(whole + b"\0")


def test_damage_is_refused_or_harmless_but_never_another_error():
    """Contents that are not compressed carry no checksum of their own: tables have hashes. All else must be noticed."""
    dice, whole = random.Random(3), packed(FACTS, {"first": b"abc" * 20}, compress=True)
    for _ in range(2000):
        content = bytearray(whole)
        for _ in range(dice.randint(1, 3)):
            content[dice.randrange(len(content))] = dice.randrange(256)
        try:
            again = Parcel.unpack(bytes(content))
        except ParcelError:
            continue
        assert isinstance(again.facts, dict)
        assert list(again.contents.values()) == [b"abc" * 20]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"simspec",
        MARK[:-1],
        b"simspec parcel 2\n" + packed()[len(MARK) :],
        pickle.dumps(FACTS),
        "words",
        None,
        bytearray(packed()),
        memoryview(packed()),
        [1, 2],
    ],
    ids=lambda content: f"{type(content).__name__}-{len(content) if content is not None else 0}",
)
def test_a_damaged_parcel_is_refused(content):
    with pytest.raises(ParcelError, match="not a parcel"):
        Parcel.unpack(content)


@pytest.mark.parametrize(
    "content",
    [
        forged(b""),
        forged(b"{"),
        forged(b"\xff\xfe"),
        forged(b"[" * 200_000),
        forged([]),
        forged(None),
        forged({}),
        forged({"facts": {}, "contents": []}),
        forged(head(facts=[])),
        forged(head(facts="words")),
        forged(head(contents={})["contents"]),
        forged(head(contents="ab")),
        forged(head(contents=[["a"]])),
        forged(head(contents=[["a", "4"]]), b"abcd"),
        forged(head(contents=[["a", 4.0]]), b"abcd"),
        forged(head(contents=[["a", None]]), b"abcd"),
        forged(head(contents=[["a", -4]]), b"abcd"),
        forged(head(contents=[["a", 4], ["b", -4]]), b"abcd"),
        forged(head(contents=[["a", 5]]), b"abcd"),
        forged(head(contents=[["a", 3]]), b"abcd"),
        forged(head(contents=[["a", 2**63]]), b"abcd"),
        forged(head(contents=[["a", 10**30]]), b"abcd"),
        forged(head(contents=[["a", 2], ["a", 2]]), b"abcd"),
        forged(head(contents=[[7, 4]]), b"abcd"),
        forged(head(contents=[["a", True]]), b"a"),
        forged(head(contents=[["a", 4]], compressed=True), b"abcd"),
        forged(head(contents=[["a", 0]], compressed=True)),
        MARK + (2**64 - 1).to_bytes(LENGTH, "big") + b"{}",
        MARK,
        MARK + b"\0" * LENGTH,
    ],
)
def test_a_head_that_lies_is_refused(content):
    with pytest.raises(ParcelError, match="damaged"):
        Parcel.unpack(content)


def test_a_content_that_would_unpack_to_more_than_is_allowed_is_refused(monkeypatch):
    monkeypatch.setattr(remote, "LARGEST_CONTENT", 99_999)
    with pytest.raises(ParcelError, match="too large, or not whole"):
        Parcel.unpack(packed(compress=True))
    monkeypatch.setattr(remote, "LARGEST_CONTENT", 100_000)
    assert Parcel.unpack(packed(compress=True)).contents == CONTENTS


def test_something_behind_a_compressed_content_is_refused():
    content = zlib.compress(b"abc") + b"more"
    with pytest.raises(ParcelError, match="not whole"):
        Parcel.unpack(forged(head(contents=[["a", len(content)]], compressed=True), content))


# --- results ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sent():
    return result_data(result_of(run(WORLD), KEY, cell={"key": "c"}), "0.")


def written(result) -> dict[str, tuple[int, bytes]]:
    tables = {}
    for name, write in result.tables.items():
        file = io.BytesIO()
        tables[name] = (write(file), file.getvalue())
    return tables


def test_a_result_comes_back_with_its_tables(sent):
    facts, contents = sent
    travelled = Parcel.unpack(Parcel(facts, contents).pack())
    again = result_from(travelled.facts, travelled.contents, "0.")
    before = result_of(run(WORLD), KEY, cell={"key": "c"})
    assert (again.key, again.result, again.request) == (KEY, before.result, before.request)
    assert again.circumstances == before.circumstances
    assert written(again) == written(before)
    assert {"states", "bodies", "seconds"} <= set(again.tables)


@pytest.mark.parametrize(
    "change",
    [
        lambda facts: facts.pop("result"),
        lambda facts: facts.pop("rows"),
        lambda facts: facts.pop("circumstances"),
        lambda facts: facts.pop("key"),
        lambda facts: facts["result"].pop("world"),
        lambda facts: facts["result"].update(more=1),
        lambda facts: facts["result"].update(engine=7),
        lambda facts: facts["asked"].update(outcomes="none"),
        lambda facts: facts.update({"asked": None}),
        lambda facts: facts.update(circumstances=3),
        lambda facts: facts.update(rows=[1]),
        lambda facts: facts["rows"].update(states="10"),
        lambda facts: facts["rows"].update(states=True),
        lambda facts: facts["rows"].update(missing=3),
    ],
)
def test_a_damaged_result_is_refused(sent, change):
    facts, contents = sent
    spoilt = json.loads(json.dumps(facts))
    change(spoilt)
    with pytest.raises(ParcelError, match="not the result of a run"):
        result_from(spoilt, contents, "0.")


@pytest.mark.parametrize("name", ["../../outside", "/tmp/outside", "run.json", "States", "", "a" * 70])
def test_a_table_is_never_written_elsewhere(sent, name):
    facts, contents = sent
    spoilt = json.loads(json.dumps(facts))
    spoilt["rows"][name] = 1
    with pytest.raises(ParcelError, match="a table"):
        result_from(spoilt, {**contents, f"0.{name}": b""}, "0.")


def test_content_that_is_not_a_mapping_is_refused(sent):
    for data in (None, 7, "words", [1], []):
        with pytest.raises(ParcelError, match="not the result of a run"):
            result_from(data, sent[1], "0.")
