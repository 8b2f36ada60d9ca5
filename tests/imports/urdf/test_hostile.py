"""Untrusted files: each ends in an error with its place, soon, and nothing is read that may not be."""

import random

import pytest

from simspec.errors import SpecError
from simspec.imports.urdf.importer import UrdfImporter
from simspec.language.foreign import ImportOptions
from tests.imports.urdf.robots import SPECIMEN, refused, two_links, watched

BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {name} "{f"&{below};" * 10}">' for below, name in zip("abcdefgh", "bcdefghi", strict=True)
)

FILES = {
    "empty": b"",
    "no XML": b"\x00\x01\x02robot",
    "another root": b"<sdf/>",
    "bomb": (BOMB + ']><robot name="&i;"/>').encode(),
    "doctype": b'<!DOCTYPE robot SYSTEM "http://127.0.0.1/x.dtd"><robot name="r"/>',
    "outer entity": b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>',
    "an entity": b'<robot name="&x;"/>',
    "depth": b'<robot name="r">' + b"<a>" * 100_000,
    "depth that closes": b'<robot name="r">' + b"<a>" * 250 + b"</a>" * 250 + b"</robot>",
    "UTF-16": two_links().encode("utf-16"),
    "UTF-16 that says so": ('<?xml version="1.0" encoding="utf-16"?>' + two_links()).encode("utf-16"),
    "not UTF-8": two_links().replace("two", "zw\xf6i").encode("latin-1"),
    "NaN": two_links('<origin xyz="0 0 nan"/>').encode(),
    "infinity": two_links('<limit lower="-inf"/>', kind="revolute").encode(),
    "too large a number": two_links('<origin xyz="0 0 1e999"/>').encode(),
    "words for numbers": two_links('<origin xyz="a b c"/>').encode(),
    "underscores": two_links('<origin xyz="1_0 0 0"/>').encode(),
    "two numbers": two_links('<origin xyz="1 2"/>').encode(),
    "no links": b'<robot name="r"/>',
    "too many prefixes": b'<robot name="r">' + b"".join(b"<a%d:b/>" % n for n in range(40)) + b"</robot>",
}


FILES["too many links"] = b'<robot name="r">' + b"".join(b'<link name="l%d"/>' % n for n in range(8_001)) + b"</robot>"


@pytest.mark.parametrize("name", FILES)
def test_each_is_refused_with_its_place(tmp_path, name):
    assert refused(FILES[name], tmp_path)


@pytest.mark.parametrize("step", range(1, 60))
def test_a_file_that_ends_early_is_refused(tmp_path, step):
    refused(SPECIMEN.encode()[: step * len(SPECIMEN) // 60], tmp_path)


def test_random_bytes_are_refused(tmp_path):
    generator = random.Random(7)
    for _ in range(200):
        refused(generator.randbytes(generator.randrange(1, 400)), tmp_path)


DECLARED = ('<?xml version="0.0"?>', "<!-- a robot --> \n<?xml version='1.0'\n?>\n", "\n<?xml version='1.0'?>")


@pytest.mark.parametrize("before", DECLARED)
def test_a_declaration_that_is_wrong_means_nothing(tmp_path, before):
    (tmp_path / "r.urdf").write_text(before + two_links())
    imported = UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions())
    assert imported.places["model", "bodies", "arm"].line == before.count("\n") + 3


def test_words_of_others_keep_their_prefix_declared_or_not(tmp_path):
    more = '<drake:filter name="f"/><gz:sensor xmlns:gz="http://gz"/>'
    (tmp_path / "r.urdf").write_text(two_links('<limit drake:acceleration="3"/>', more=more))
    accounts = UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions()).accounts
    lost = {account.what for account in accounts if account.reason}
    assert lost == {"drake:filter[f]", "gz:sensor", "joint[hinge]/limit/@drake:acceleration"}


def test_a_text_in_other_letters_is_no_defect(tmp_path):
    (tmp_path / "r.urdf").write_bytes(b"\xef\xbb\xbf" + two_links().replace('name="two"', 'name="zwöi"').encode())
    imported = UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions())
    assert imported.data["name"] == "zwoi"


def test_many_links_are_read_without_recursion(tmp_path):
    count = 3000
    links = "".join(f'<link name="l{i}"/>' for i in range(count))
    joint = '<joint name="j{0}" type="fixed"><parent link="l{0}"/><child link="l{1}"/></joint>'
    joints = "".join(joint.format(i, i + 1) for i in range(count - 1))
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    imported = UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions())
    assert len(imported.data["model"]["bodies"]) == count


def test_a_name_that_is_a_command_is_a_name(tmp_path):
    command = "$(touch pwned); `touch pwned` ; rm -rf ~"
    text = two_links().replace('name="two"', f'name="{command}"').replace('"arm"', f'"{command}"')
    (tmp_path / "r.urdf").write_text(text)
    imported = UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions())
    assert imported.data["name"] == "touch_pwned_touch_pwned_rm_-rf"
    assert not (tmp_path / "pwned").exists()


def test_only_the_file_itself_is_opened(tmp_path):
    """The watch sees every file that Python opens; entities and document types name others."""
    for name in ("doctype", "outer entity", "bomb"):
        (tmp_path / "r.urdf").write_bytes(FILES[name])
        opened: list[str] = []
        with watched(opened), pytest.raises(SpecError):
            UrdfImporter().read(tmp_path / "r.urdf", "r.urdf", ImportOptions(project=tmp_path))
        assert any("r.urdf" in path for path in opened)
        assert all("r.urdf" in path or path.endswith((".py", ".pyc", ".so")) for path in opened), opened


def test_a_folder_of_packages_that_is_a_link_to_itself_has_nothing(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "robot.urdf").write_text(two_links())
    for words in ({"packages": {"p": str(tmp_path / "loop")}}, {"package_path": (str(tmp_path / "loop"),)}):
        assert UrdfImporter().read(tmp_path / "robot.urdf", "robot.urdf", ImportOptions(project=tmp_path, **words)).data
