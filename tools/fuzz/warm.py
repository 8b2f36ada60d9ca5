"""Python programs that are forked from this process, in place of being started: the readers that simspec starts for one file
each take half a second to import what they need, which is here already. Their behaviour and their limits are the same."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from typing import Any

MOST_DESCRIPTORS = 512


class Forked(subprocess.Popen):  # type: ignore[type-arg]
    """A process of a Python program: ``-m MODULE`` or a path, after flags."""

    def _execute_child(self, args: Any, *rest: Any) -> None:
        (_, _, _, pass_fds, cwd, env, _, _, _, p2cread, p2cwrite, c2pread, c2pwrite, _, errwrite, *_) = rest
        words = list(map(str, args[1:]))
        self.pid = os.fork()
        if self.pid == 0:
            code = 70
            try:
                self._become(words, (p2cread, c2pwrite, errwrite), pass_fds, cwd, env)
                code = 0
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else 1
            except BaseException:
                code = 1
            finally:
                os._exit(code)
        self._child_created = True
        for mine, theirs in ((p2cwrite, p2cread), (c2pread, c2pwrite)):
            if mine != -1 and theirs != -1:
                os.close(theirs)
        if errwrite != -1:
            os.close(errwrite)

    def _become(self, words: list[str], streams: tuple[int, ...], passed: Any, cwd: Any, env: Any) -> None:
        os.setsid()
        for number, stream in enumerate(streams):
            if stream != -1:
                os.dup2(stream, number)
        for descriptor in range(3, MOST_DESCRIPTORS):
            if descriptor not in passed:
                try:
                    os.close(descriptor)
                except OSError:
                    continue
        if cwd is not None:
            os.chdir(cwd)
        if env is not None:
            os.environ.clear()
            os.environ.update(env)
        sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
        module = "-m" in words
        while words[0].startswith("-"):
            words.pop(0)
        sys.argv = list(words)
        if module:
            runpy.run_module(words[0], run_name="__main__", alter_sys=False)
        else:
            runpy.run_path(words[0], run_name="__main__")
        sys.stdout.flush()
