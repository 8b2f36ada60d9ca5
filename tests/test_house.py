"""The rules of the house: data goes one way, engines are known by name only where they live, files stay readable."""

from __future__ import annotations

import ast
import collections
import functools
import re
from pathlib import Path

import pytest

from tests.conftest import LONGEST as FIRST
from tests.modules import MODULES, PACKAGE, TEST_MODULES, TESTS, name_of, offences, parsed

ORDER = (
    "distribution",
    "processes",
    "confinement",
    "errors",
    "codes",
    "files",
    "numerals",
    "plugins",
    "methods",
    "mapped",
    "stored",
    "outputs",
    "language",
    "world",
    "meshes",
    "dynamics",
    "control",
    "resolve",
    "support",
    "contact",
    "formats",
    "imports",
    "plausibility",
    "dialects",
    "engines",
    "project",
    "option_checks",
    "compiler",
    "selection",
    "proof",
    "audit",
    "runner",
    "testing",
    "comparison",
    "analysis",
    "experiments",
    "attribution",
    "generated",
    "api",
    "report",
    "commands",
    "cli",
)
"""A module imports only from parts that stand before its own, and from its own."""
EXCEPTIONS = {
    ("language/load.py", "world"): "only the type, for Spec.resolve()",
    ("language/load.py", "resolve"): "Spec.resolve() is the user's door to the next part; imported when it is called",
}
ENTRANCES = ("__init__.py", "__main__.py")
"""The package's own doors, which may open every part."""
LONGEST = 500
IN_SPEC_AND_WORLD = (
    "Body",
    "Contact",
    "EngineOptions",
    "Fluid",
    "Frame",
    "Joint",
    "Material",
    "PairSettings",
    "Physics",
    "Pose",
    "Shape",
)
"""Class names that stand for two classes: the model of a spec's text (``simspec.language``, where the name is a definition of
the JSON schema and of docs/reference/language.md), and the same thing resolved (``simspec.world``). All others are unique."""
HOMES = ("engines", "dialects", "formats", "imports")
"""An engine or a format is named in its own packages of these, and nowhere else: in no name, text, comment or docstring."""
ALSO = {"pybullet": ("bullet",)}
"""Further names of engines; other engines' packages may contain them (a collision detector has the same name)."""
BUILT_ON = {"genesis": {"mujoco"}, "gzsim": {"gazebo"}, "mjwarp": {"mujoco"}, "mjx": {"mujoco"}}
"""Engines that reimplement the dynamics of another engine and read its files: their packages import and name it."""
NAMED_ELSEWHERE = {
    ("__init__.py", ">>>"): "the first example that a user reads is one to type in",
    ("formats/mjcf", '"mujoco"'): "the root element of the language",
    ("formats/urdf", '"mujoco"'): "an element of the files, for the one reader that knows it",
    ("formats/urdf", "<mujoco>"): "the same, in a comment",
    **{
        ("audit/libraries.py", part): "the languages that libraries read, of which no package of an engine can say it"
        for part in ("urdf", "URDF", "Urdf", "mjcf", "MJCF", '"mujoco"', "usd", "Usd", "USD")
    },
    ("formats/mjcf", "<mujoco>"): "the same, in a message",
    ("engines/dart/readback.py", '"mujoco"'): "the root element of a language that it reads",
    ("engines/drake/readback.py", '"mujoco"'): "the same",
    ("engines/pybullet/foreign.py", '"mujoco"'): "the same",
    **{("engines/kit/hulls", part): "the library that these are a class of geoms for" for part in ("ode", "ODE")},
    ("dialects/dart", "ode"): "a collision detector of that engine's",
    ("engines/dart", "ode"): "the same",
    ("imports/sdf/shapes.py", "ode"): "an element of the language",
    **{("imports/sdf/values.py", part): "elements of old files" for part in ("ode", "bullet", "gazebo")},
    ("imports/sdf/models.py", "<friction><ode>"): "an element of the language",
    ("imports/sdf/models.py", "</ode></friction>"): "the same",
    ("imports/sdf/models.py", "osrf/gazebo_models"): "the source of a figure",
    ("imports/files.py", "IGN_GAZEBO_RESOURCE_PATH"): "a variable of the environment that names folders of models",
    ("imports/files.py", "GAZEBO_MODEL_PATH"): "the same",
    ("imports/files.py", "SDF_PATH"): "the same",
    ("dialects/pybullet/defects.py", "gazebo"): "an element of the language",
    **{("imports/urdf", part): "the same" for part in ("gazebo", "Gazebo", "GAZEBO")},
    ("dialects/gazebo.py", "DART"): "the library that is that engine's own engine",
    **{
        ("engines/gazebo", part): "the same, by its detector"
        for part in ("DART", "Dart", "dart", "Ode", "ode", "Sdf", "SDF", "sdf")
    },
    **{("engines/gzsim", part): "the same library" for part in ("DART", "Sdf", "SDF", "sdf")},
    ("language/hint_words.txt", "sdf_shape"): "a word for signed distance fields",
    ("dialects/webots", "ODE"): "the library of which that engine has a copy",
    ("engines/webots", "ODE"): "the same",
    ("imports/xacro/__init__.py", ".urdf"): "an end of names of its files, too",
    ("imports/xacro/importer.py", "urdf"): "the format to which xacro files expand, and its importer",
    ("imports/xacro/importer.py", "URDF"): "the same, in messages",
    **{("imports/urdf", part): "elements of the files that are read" for part in ("drake:", "Drake's words")},
    **{("imports/usd", part): "a prefix of what a converter writes" for part in ("urdf:", "a URDF", "of URDF")},
    ("imports/urdf/elements.py", '"mujoco"'): "an element of the files that are read",
    ("imports/urdf/elements.py", "MuJoCo's own reader"): "the purpose of that element",
    ("imports/mjcf", '"mujoco"'): "the root element of the language",
    (
        "imports/mjcf/importer.py",
        "sdf_iterations sdf_initpoints",
    ): "attributes of the language, of signed distance fields",
    ("formats/usd/text.py", "Sdf"): "a module of the writer, of scene description foundations",
    ("imports/usd/child.py", "Sdf"): "a module of the reader, of scene description foundations",
    ("imports/usd/child.py", "SDF_FORMAT_ARGS"): "a word of its paths",
    **{("imports/usd", part): "a prefix of the language's schemas" for part in ("physx", "Physx", "PhysX")},
    ("imports/usd/importer.py", "Skel"): "types of prims, of skeletons",
    ("imports/usd/shapes.py", '"sdf"'): "an approximation of the language, by signed distance fields",
}
"""Words that a file or folder may contain although they name an engine, with the reason."""

WRITING = {
    *("rmtree", "write_text", "write_bytes", "rename", "renames", "replace", "unlink", "remove", "removedirs", "rmdir"),
    *(
        "symlink",
        "symlink_to",
        "link",
        "hardlink_to",
        "link_to",
        "touch",
        "mkdir",
        "makedirs",
        "copy",
        "copy2",
        "copyfile",
    ),
    *("copytree", "move", "truncate", "mkfifo", "mknod", "pwrite", "ftruncate"),
}
"""Calls that change a disk."""
OF_A_DISK = {
    "os",
    "shutil",
    "Path",
    "path",
    "file",
    "folder",
    "place",
    "target",
    "beside",
    "part",
    "fresh",
    "old",
}
"""Names that stand for a module or a path, for words that texts, lists and arrays have too (``COMMON``)."""
COMMON = {"replace", "remove", "copy", "link", "move", "truncate", "touch"}
WRITERS = {
    "outputs": "the one part that writes what a user named",
    "files.py": "temporary folders of simspec's own, and large arrays in temporary files that have no name",
    "engines/kit/compiled.py": "a compiler's words, into the folder in the cache in which it works",
    "engines/kit/messages.py": "in an engine's process: its progress, into the temporary folder of the process",
    "engines/mjx/programs.py": "in an engine's process: a program, where `outputs` has it in the cache be made",
    "engines/kit/keeper.py": "resources used by the engine's process, into its temporary folder",
    "engines/kit/warm.py": "an end of a pipe to an engine's keeper",
    "engines/kit/worker.py": "in an engine's process: results into the process's own temporary folder",
    "engines/kit/request.py": "requests and artifacts into the temporary folder of an engine's process",
    "engines/webots/program.py": "in an engine's process: the world that Webots is started on, into a temporary folder",
    "engines/kit/recorder.py": "in an engine's process: rows and progress into the process's own temporary folder",
    "engines/pybullet/inventory.py": "in an engine's process: a file to load, in a temporary folder of its own",
    "engines/gzsim/simulation.py": "in an engine's process: a file to load, in a temporary folder of its own",
    "engines/mujoco/model_compiler.py": "its answer, into the pipe to the caller",
    "meshes/child.py": "in the process that reads meshes: answers, through a pipe",
}


def part(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@functools.cache
def nodes(tree: ast.AST) -> tuple[ast.AST, ...]:
    """All nodes of a module, walked once for all rules."""
    return tuple(ast.walk(tree))


def imported_parts(tree: ast.AST) -> set[str]:
    """The parts of simspec that a module imports from, wherever in the module that is."""
    found = set()
    for node in nodes(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        found.update(name.split(".")[1] for name in names if name.startswith("simspec."))
    return found


def test_data_flows_in_a_single_direction():
    unordered = {part(path) for path in MODULES if name_of(path) not in ENTRANCES} - set(ORDER)
    assert not unordered, "these parts have no place in ORDER"
    backwards = []
    for path in MODULES:
        name, package = name_of(path), part(path)
        if name in ENTRANCES:
            continue
        for other in imported_parts(parsed(path)):
            later = other not in ORDER or ORDER.index(other) > ORDER.index(package)
            if later and (name, other) not in EXCEPTIONS:
                backwards.append(f"{name} imports from {other}, which does not stand before {package}")
    assert not backwards


def imported_modules(tree: ast.Module) -> set[str]:
    """The modules of simspec that a module imports, also inside functions; not those for types alone."""
    types_only = {
        node
        for test in nodes(tree)
        if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.dump(test.test)
        for statement in test.body
        for node in ast.walk(statement)
    }
    imported = set()
    for node in nodes(tree):
        if node in types_only:
            continue
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            imported.update(f"{node.module}.{alias.name}" for alias in node.names)
    return imported


def circle(imports: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle, by name; [] when there is none."""
    left = {name: {other for other in others if other in imports} - {name} for name, others in imports.items()}
    while True:
        free = [name for name, others in left.items() if not others]
        if not free:
            return sorted(left)
        left = {name: others - set(free) for name, others in left.items() if name not in free}
        if not left:
            return []


LAZY_CIRCLES = {
    ("simspec.runner.run", "simspec.runner.store"): "an import within a function, to be removed",
}
"""Imports (importer, imported) that close a circle although they are within functions. No new entries; one that is gone
fails the test until its entry is removed."""


def test_no_module_imports_itself_by_way_of_others():
    names = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
        for path in MODULES
    }
    imports = {
        name: {other if other in names else other.rpartition(".")[0] for other in imported_modules(parsed(path))}
        for name, path in names.items()
    }
    for importer, imported in LAZY_CIRCLES:
        imports[importer].remove(imported)
    assert not circle(imports)


def test_a_circle_is_seen():
    assert circle({"a": {"b"}, "b": {"c", "d"}, "c": {"a"}, "d": set()}) == ["a", "b", "c"]
    assert circle({"a": {"b", "x"}, "b": set()}) == []
    text = "import simspec.a\nif TYPE_CHECKING:\n    import simspec.b\ndef f():\n    import simspec.c\n"
    text += "try:\n    from simspec import d\nfinally:\n    pass"
    assert imported_modules(ast.parse(text)) == {"simspec.a", "simspec.c", "simspec.d"}


def packages(home: str) -> set[str]:
    """Names of the packages in a folder of engines, dialects or formats: of engines and formats, but no common part."""
    return {path.parent.name for path in (PACKAGE / home).glob("*/__init__.py")} - {"kit"}


ENGINES = packages("engines") - {"newton"}
"""Engines but the one whose name is that of a unit, of a method, and of a vendor's attributes in USD."""
FORMATS = packages("formats") - {"world"}
"""Formats but the neutral one, whose name is a common word."""


def foreign_words(path: str) -> set[str]:
    """Names that a file of simspec (path inside the package) may not contain: engines and formats of other packages."""
    folder, name = (*path.split("/"), "", "")[:2]
    stem = name.removesuffix(".py") if folder in HOMES else ""
    if stem in ENGINES:
        return ENGINES - {stem} - BUILT_ON.get(stem, set())
    engines = ENGINES | {word for words in ALSO.values() for word in words}
    if stem in FORMATS:
        return engines | (FORMATS - {stem})
    return engines | FORMATS


SHORT = 3
"""Names of so few letters are parts of common words: those are words of their own, or begin one in capitals."""


def says(line: str, word: str) -> bool:
    """Whether a line says the name of an engine or a format."""
    if word not in line.lower():
        return False
    if len(word) > SHORT or word in FORMATS:
        return True
    return re.search(rf"(?<![A-Za-z])(?:{word}|{word.upper()}|{word.title()})(?![a-z])", line) is not None


def named(path: str, text: str) -> list[str]:
    """Lines of a file that name what is foreign there; comments, docstrings and texts count as code does."""
    allowed = [part for place, part in NAMED_ELSEWHERE if path == place or path.startswith(f"{place}/")]
    foreign, reasons = foreign_words(path), []
    for number, line in enumerate(text.splitlines(), 1):
        if any(line.startswith(part) for part in allowed if part == ">>>"):
            continue
        for part in allowed:
            line = line.replace(part, "")
        reasons += [f"{path}:{number}: {word}: {line.strip()}" for word in foreign if says(line, word)]
    return reasons


FILES = sorted(path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


def test_engines_and_formats_are_named_only_at_home():
    assert not [line for path in FILES for line in named(name_of(path), path.read_text(encoding="utf-8"))]


def test_the_names_are_those_of_the_packages():
    assert {"mujoco", "pybullet", "dart", "drake", "ode"} <= ENGINES
    assert {"mjcf", "urdf", "skel", "sdf", "usd", "wbt"} == FORMATS


@pytest.mark.parametrize("path", ["proof/motion.py", "engines/kit/worker.py", "help.txt", "formats/world/write.py"])
@pytest.mark.parametrize(
    "text",
    [
        "x = pybullet.y",
        '"""As URDF."""',
        "# DART's",
        "'Bullet'",
        "def drake_only(): ...",
        ".skel",
        "ODE's",
        "class OdeFirst",
    ],
)
def test_a_name_away_from_home_is_seen(path, text):
    assert named(path, text)


@pytest.mark.parametrize(
    ("path", "free", "foreign"),
    [
        ("engines/dart/engine.py", "DART reads .skel and URDF; its bullet detector", "as MuJoCo"),
        ("dialects/urdf/dialect.py", "URDF", "as PyBullet"),
        ("formats/urdf/write.py", "URDF", "for DART"),
        ("formats/urdf/write.py", "URDF", "as MJCF"),
        ("formats/mjcf/reading.py", 'tag != "mujoco"', "MuJoCo's default"),
        ("__init__.py", '>>> run("dart")', 'run("dart")'),
        ("proof/units.py", "the standard unit", "the dart's unit"),
        ("proof/units.py", "the model of a node, to decode", "the behaviour of ODE"),
    ],
)
def test_a_name_at_home_is_not_foreign(path, free, foreign):
    assert not named(path, free)
    assert named(path, foreign)


def test_files_stay_readable():
    lengths = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert not {name: length for name, length in lengths.items() if length > LONGEST}


def test_class_names_are_unique():
    homes = collections.defaultdict(list)
    for path in MODULES:
        for node in nodes(parsed(path)):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(name_of(path))
    shared = {name: paths for name, paths in homes.items() if len(paths) > 1}
    assert sorted(shared) == sorted(IN_SPEC_AND_WORLD)
    assert {tuple(sorted(path.split("/")[0] for path in paths)) for paths in shared.values()} == {("language", "world")}


def writes(tree: ast.AST) -> list[tuple[int, str]]:
    """Calls that change a disk: by their names, and ``open`` for anything but reading."""
    found = []
    for node in nodes(tree):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        if name in WRITING:
            owner = function.value if isinstance(function, ast.Attribute) else None
            plain = owner.id if isinstance(owner, ast.Name) else None
            if name not in COMMON or plain in OF_A_DISK:
                found.append((node.lineno, name))
        elif name in ("open", "fdopen"):
            modes = [*node.args, *(key.value for key in node.keywords if key.arg == "mode")]
            texts = [mode.value for mode in modes if isinstance(mode, ast.Constant) and isinstance(mode.value, str)]
            if any(set(text) & set("wax+") and set(text) <= set("rwaxbt+") for text in texts):
                found.append((node.lineno, f"{name} {texts}"))
    return found


def test_only_the_outputs_package_writes_files():
    others = [path for path in MODULES if not {part(path), name_of(path)} & WRITERS.keys()]
    assert not offences(writes, others)


SAYERS = {"report/screen.py", "cli.py", "engines/kit/registry.py"}
"""Modules that print: the one that escapes what is not seen or does more than be seen, the version, and a child's script."""


def test_texts_are_printed_by_the_module_that_escapes_them():
    """A file's name may hold control characters of a terminal."""
    assert not offences(prints, [path for path in MODULES if name_of(path) not in SAYERS])


def prints(tree: ast.AST) -> list[int]:
    """Lines that print."""
    calls = [node.func for node in nodes(tree) if isinstance(node, ast.Call)]
    return [call.lineno for call in calls if isinstance(call, ast.Name) and call.id == "print"]


TEMPORARY = {"files.py", "processes.py"}
"""Modules that may make temporary files themselves: files left by a killed process must have a marker for the next process,
or no name."""


def temporary(tree: ast.AST) -> set[str]:
    """Names of functions that make temporary files."""
    return {"TemporaryDirectory", "mkdtemp", "NamedTemporaryFile", "mkstemp"} & words_as_written(tree)


def test_temporary_folders_are_marked():
    assert not offences(temporary, [path for path in MODULES if name_of(path) not in TEMPORARY])


def all_features_listed(tree: ast.AST) -> list[int]:
    """Lines that go through every feature to make something: a new feature would be declared there without a word."""
    lines = []
    for node in nodes(tree):
        given: list[ast.expr] = []
        if isinstance(node, ast.Call):
            given = [*node.args, *(key.value for key in node.keywords)]
        elif isinstance(node, (ast.comprehension, ast.For)):
            given = [node.iter]
        elif isinstance(node, ast.Starred):
            given = [node.value]
        lines.extend(node.lineno for node in given if isinstance(node, ast.Name) and node.id == "Feature")
    return lines


def test_tables_of_support_name_every_feature():
    declaring = [path for path in MODULES if part(path) in ("formats", "dialects", "engines")]
    assert not offences(all_features_listed, declaring)


def test_tables_that_name_no_feature_are_seen():
    text = """
dict.fromkeys(Feature, EXACT)
exactly(*Feature); dict.fromkeys(tuple(Feature)); alike(EXACT, *list(Feature))
{feature: EXACT for feature in Feature}
for feature in Feature: table[feature] = EXACT
exactly(Feature.JOINT_FIXED); Feature("joint.fixed"); x: Mapping[Feature, Support] = {Feature.CONTROL: EXACT}
"""
    assert sorted(all_features_listed(ast.parse(text))) == [2, 3, 3, 3, 4, 5]


def words_as_written(tree: ast.AST) -> set[str]:
    """Every name and attribute in a module."""
    return {
        node.attr if isinstance(node, ast.Attribute) else node.id
        for node in nodes(tree)
        if isinstance(node, (ast.Attribute, ast.Name))
    }


def test_the_checks_find_prints_and_names():
    tree = ast.parse("def f():\n    print(1)\n    x.print(2)\n    tempfile.mkdtemp(mkstemp)\n")
    assert prints(tree) == [2]
    assert {"mkdtemp", "mkstemp"} <= words_as_written(tree)


def test_the_check_finds_code_that_writes():
    text = """
import os, shutil
shutil.rmtree(x); os.replace(a, b); path.write_text("x"); open(p, "w"); p.open("xb"); open(p, mode="a"); x.unlink()
"a".replace("b", "c"); open(p); open(p, "rb"); names.remove(1); array.copy()
"""
    assert len(writes(ast.parse(text))) == 7


def test_imports_are_seen_wherever_they_stand():
    assert imported_parts(ast.parse("def f():\n    from simspec.report import a")) == {"report"}


def between_tests(tree: ast.Module) -> list[str]:
    """Imports of a module from test modules, also inside its functions."""
    names = [alias.name for node in nodes(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [
        f"{node.module}.{alias.name}"
        for node in nodes(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    return [name for name in names if name.startswith("tests.") and ".test_" in name]


def test_no_test_imports_from_another():
    """Helpers of several tests are in modules of their own."""
    assert not offences(between_tests, TEST_MODULES)


def test_a_test_that_imports_from_another_is_seen():
    text = "import tests.a.test_b\nfrom tests.test_c import d\nfrom tests import test_e\nfrom tests.f import test_g\n"
    assert len(between_tests(ast.parse(text + "from tests import worlds"))) >= 4


def test_files_that_take_long_are_there_to_be_begun_first():
    assert [file for file in FIRST if not (TESTS / file).is_file()] == []
