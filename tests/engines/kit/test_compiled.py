"""Parts of an engine that are compiled on first use: kept whole under a key, and each way to fail has words of its own."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simspec.engines.kit import compiled
from simspec.engines.kit.compiled import CompileError, Missing, NativeBinary, package_version
from simspec.errors import EXIT_ENGINE
from tests.files import program

SOUND = "double twice(double x) { return 2.0 * x; }\n"
COUNTING = """#!/bin/sh
case "$*" in *--version*) echo "a compiler 1.0";; *) echo x >> {log};; esac
exec {compiler} "$@"
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a cache of its own, and a compiler that counts what it compiles."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("CC", "CXX", "PKG_CONFIG_PATH"):
        monkeypatch.delenv(name, raising=False)
    real = shutil.which("cc")
    assert real is not None, "a C compiler is needed"
    program(tmp_path / "bin" / "cc", COUNTING.format(log=tmp_path / "log", compiler=real))
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    return tmp_path


def of(place: Path, text: str = SOUND, **more) -> NativeBinary:
    source = place / "part.c"
    source.write_text(text)
    return NativeBinary("toy", "toy-part", (source,), **more)


def count(place: Path) -> int:
    log = place / "log"
    return len(log.read_text().splitlines()) if log.exists() else 0


def left(place: Path) -> list[str]:
    """The content of the cache without the lock."""
    return sorted(
        path.name for path in (place / "cache" / "simspec" / "compiled" / "toy-part").glob("*") if path.name != "lock"
    )


def failure(what: NativeBinary, **more) -> CompileError:
    with pytest.raises(CompileError) as raised:
        what.file(**more)
    assert raised.value.exit_code == EXIT_ENGINE
    assert str(raised.value).startswith("toy: ")
    return raised.value


def test_it_is_compiled_once_and_works(place):
    library = of(place).load()
    library.twice.restype, library.twice.argtypes = compiled.ctypes.c_double, [compiled.ctypes.c_double]
    assert library.twice(1.5) == 3.0
    assert of(place).file() == of(place).file()
    assert count(place) == 1
    assert left(place) == [of(place).file().name]
    assert stat.S_IMODE(of(place).file().stat().st_mode) == 0o700


def test_a_program_is_run(place):
    made = of(place, '#include <stdio.h>\nint main(void) { puts("here"); }\n', program=True).file()
    assert subprocess.run([made], capture_output=True, check=True).stdout == b"here\n"


def test_the_inputs_of_a_build_are_its_key(place):
    header = place / "part.h"
    header.write_text("#define BY 2.0\n")
    text = '#include "part.h"\ndouble twice(double x) { return BY * x; }\n'
    files = {of(place, text, headers=(header,)).file(), of(place, text, headers=(header,), flags=("-O1",)).file()}
    assert len(files) == 2
    header.write_text("#define BY 3.0\n")
    compiled._recipe.cache_clear()  # as in another process: sources of an installed package do not change under one
    files.add(of(place, text, headers=(header,)).file())
    program(place / "bin" / "cc", (place / "bin" / "cc").read_text().replace("1.0", "1.1"))
    compiled._recipe.cache_clear()
    files.add(of(place, text, headers=(header,)).file())
    assert len(files) == 4
    assert count(place) == 4


def test_no_more_are_kept_than_are_used(place):
    for number in range(10):
        of(place, f"int x = {number};\n", flags=(f"-DN={number}",)).file()
    assert len(left(place)) == 8


def test_two_at_once_compile_once(place):
    of(place)
    text = (
        "import sys; from pathlib import Path; from simspec.engines.kit.compiled import NativeBinary\n"
        "print(NativeBinary('toy', 'toy-part', (Path(sys.argv[1]),)).file())"
    )
    program(place / "bin" / "cc", (place / "bin" / "cc").read_text().replace(";; esac", "; sleep 0.5;; esac"))
    command = [sys.executable, "-c", text, str(place / "part.c")]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = {popen.communicate()[0] for popen in both}
    assert [popen.returncode for popen in both] == [0, 0]
    assert len(said) == 1
    assert count(place) == 1


def test_a_damaged_library_is_compiled_again(place):
    file = of(place).file()
    file.write_bytes(file.read_bytes()[:100])
    assert of(place).load().twice
    assert count(place) == 2


def test_a_check_loads_in_a_separate_process(place):
    """Libraries of two engines in one process may be the end of it."""
    file = of(place).file()
    of(place).check()
    assert str(file) not in Path("/proc/self/maps").read_text(encoding="utf-8")
    file.write_bytes(file.read_bytes()[:100])
    of(place).check()
    assert count(place) == 2
    absent = of(place, "double absent(void); double twice(double x) { return absent() * x; }\n", flags=("-Wl,-z,now",))
    with pytest.raises(CompileError, match="undefined symbol: absent") as raised:
        absent.check()
    assert raised.value.missing is Missing.LOADS


def test_a_library_that_never_loads_is_an_error(place):
    what = of(place, "double absent(void); double twice(double x) { return absent() * x; }\n", flags=("-Wl,-z,now",))
    with pytest.raises(CompileError, match="undefined symbol: absent") as raised:
        what.load()
    assert raised.value.missing is Missing.LOADS


def test_a_compile_error_has_the_compilers_words_and_leaves_nothing(place):
    error = failure(of(place, "double twice(double x) { return 2.0 * y; }\n"))
    assert error.missing is Missing.SOURCE
    assert "part.c:1:" in str(error)
    assert "'y' undeclared" in str(error)
    assert left(place) == []


def test_a_missing_header_is_named(place):
    error = failure(of(place, "#include <nowhere/none.h>\n"))
    assert error.missing is Missing.HEADER
    assert "the header nowhere/none.h is not installed" in str(error)


def test_a_missing_library_is_named(place):
    error = failure(of(place, links=("-lnowhere_at_all",)))
    assert error.missing is Missing.LIBRARY
    assert "the library nowhere_at_all is not installed" in str(error)


def test_a_missing_compiler_is_named(place, monkeypatch):
    (place / "empty").mkdir()
    monkeypatch.setenv("PATH", str(place / "empty"))
    error = failure(of(place))
    assert error.missing is Missing.COMPILER
    assert "no C compiler: cc or gcc or clang is not on the path" in str(error)
    monkeypatch.setenv("CC", "my-cc -m64")
    assert "my-cc (the environment variable CC) is not on the path" in str(failure(of(place)))


def test_invalid_flags_are_reported(place, monkeypatch):
    monkeypatch.setenv("CC", "cc '-DA")
    error = failure(of(place))
    assert error.missing is Missing.COMPILER
    assert "the environment variable CC is no list of words: No closing quotation: cc '-DA" in str(error)
    monkeypatch.delenv("CC")
    text = "#!/bin/sh\ncase $1 in --cflags) {}; esac\n"
    program(place / "bin" / "pkg-config", text.format('echo "\'-DA";'))
    assert "the output of pkg-config --cflags is no list of words" in str(failure(of(place, packages=("toys",))))
    program(place / "bin" / "pkg-config", text.format("exit 5;"))
    compiled._recipe.cache_clear()
    assert "pkg-config --cflags ended with code 5" in str(failure(of(place, packages=("toys",))))


def test_a_compiler_that_says_much_is_quoted_in_part(place):
    script = "#!/bin/sh\ncase $1 in --version) exit;; esac\nhead -c 3000000 /dev/zero | tr '\\0' x\nexit 4\n"
    program(place / "bin" / "cc", script)
    error = failure(of(place))
    assert error.missing is Missing.SOURCE
    assert "ended with code 4" in str(error)
    assert len(str(error)) < 3000


def test_a_process_that_is_killed_while_it_compiles_leaves_nothing_in_the_way(place):
    of(place)
    slow = (place / "bin" / "cc").read_text().replace(";; esac", "; sleep 30;; esac")
    quick = (place / "bin" / "cc").read_text()
    program(place / "bin" / "cc", slow)
    text = (
        "import sys; from pathlib import Path; from simspec.engines.kit.compiled import NativeBinary\n"
        "print(NativeBinary('toy', 'toy-part', (Path(sys.argv[1]),)).file())"
    )
    command = [sys.executable, "-c", text, str(place / "part.c")]
    popen = subprocess.Popen(command, start_new_session=True)
    ends = time.monotonic() + 20.0
    while count(place) == 0:
        assert time.monotonic() < ends
        time.sleep(0.02)
    popen.kill()
    popen.wait()
    assert [name for name in left(place) if name.startswith("tmp-")]
    program(place / "bin" / "cc", quick)
    compiled._recipe.cache_clear()
    made = of(place).file()
    assert left(place) == [made.name]


def test_the_compiler_that_is_given_is_taken(place, monkeypatch):
    program(place / "bin" / "my-cc", (place / "bin" / "cc").read_text().replace(str(place / "log"), str(place / "own")))
    monkeypatch.setenv("CC", "my-cc -DBY=2")
    of(place, "double twice(double x) { return BY * x; }\n").file()
    assert (place / "own").exists()
    assert count(place) == 0


def test_packages_give_flags_and_their_version(place, monkeypatch):
    """A library of the test's own, with its header in a folder of its own."""
    (place / "include").mkdir()
    (place / "include" / "toys.h").write_text("#define BY 2.0\n")
    description = f"Name: toys\nDescription: of a test\nVersion: 1.2\nCflags: -I{place / 'include'}\n"
    (place / "toys.pc").write_text(description)
    monkeypatch.setenv("PKG_CONFIG_PATH", str(place))
    text = "#include <toys.h>\ndouble twice(double x) { return BY * x; }\n"
    assert package_version("toys") == "1.2"
    first = of(place, text, packages=("toys >= 1.0",)).file()
    newer = failure(of(place, text, packages=("toys >= 2",)))
    assert newer.missing is Missing.PACKAGE
    assert "'1.2'" in str(newer)
    (place / "toys.pc").write_text(description.replace("1.2", "1.3"))
    compiled.forget_packages()
    assert package_version("toys") == "1.3"
    assert of(place, text, packages=("toys >= 1.0",)).file() != first
    assert package_version("no-such-toys") is None
    assert "no no-such-toys: its development files are not installed" in str(
        failure(of(place, packages=("no-such-toys",)))
    )


def test_a_missing_pkg_config_is_reported(place, monkeypatch):
    monkeypatch.setenv("PATH", str(place / "bin"))
    assert failure(of(place, packages=("toys",))).missing is Missing.PKG_CONFIG


def test_a_compiler_that_does_not_end_is_ended_with_all_that_it_started(place):
    program(
        place / "bin" / "cc", f"#!/bin/sh\ncase $1 in --version) exit;; esac\nsleep 60 & echo $! > {place}/pid; wait\n"
    )
    error = failure(of(place), deadline=0.3)
    assert error.missing is Missing.TIME
    assert left(place) == []
    child = int((place / "pid").read_text())
    ends = time.monotonic() + 5.0
    while Path(f"/proc/{child}").exists() and Path(f"/proc/{child}/stat").read_text().split()[2] != "Z":
        assert time.monotonic() < ends, "the compiler's own child lives on"
        time.sleep(0.01)


def test_files_of_a_killed_process_are_removed(place):
    folder = of(place).file().parent
    (folder / "tmp-0123456789abcdef").mkdir()
    (folder / "tmp-0123456789abcdef" / "part.o").write_text("half")
    (folder / "mine.txt").write_text("of another program")
    of(place, flags=("-O0",)).file()
    assert "mine.txt" in left(place)
    assert len(left(place)) == 3


def test_a_file_that_others_can_write_is_not_taken(place):
    of(place).file().chmod(0o777)
    error = failure(of(place))
    assert error.missing is Missing.PLACE
    assert "this user alone" in str(error)


def test_a_missing_cache_folder_is_reported(place, monkeypatch):
    (place / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(place / "file"))
    error = failure(of(place))
    assert error.missing is Missing.PLACE
    assert "XDG_CACHE_HOME" in str(error)
