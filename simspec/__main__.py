"""The start of the command line: answers ``--help`` from a stored text, and leaves the rest to ``simspec.cli``.

Building the help from the commands takes longer than anything else about asking for it; ``help.txt`` is made from them by
``python -m simspec.cli --write-help``, and a test fails when it is stale. Only what every Python has loaded is imported.
"""

import atexit
import gc
import io
import os
import sys

COMPLETE = "_SIMSPEC_COMPLETE"
"""The variable with which a shell's script requests the words that may follow; its value is the name of the shell."""


def main() -> int:
    """Run the command line; the exit code."""
    arguments = sys.argv[1:]
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # the caller closed it
            setattr(sys, name, io.StringIO())
        else:  # names of files may be no text, and a terminal may have few letters: shown escaped then
            stream.reconfigure(errors="backslashreplace")
    if arguments and COMPLETE in os.environ:
        from simspec.commands.completion import answer

        return answer(arguments, os.environ[COMPLETE])
    if not arguments or arguments in (["--help"], ["-h"], ["help"]):
        with open(__file__.removesuffix("__main__.py") + "help.txt", encoding="utf-8") as file:
            text = file.read()
        return _write(text)
    # most objects of modules and worlds live as long as the process: examining them takes a sixth of a short command's time
    gc.set_threshold(200_000, 50, 50)
    atexit.register(gc.disable)
    from simspec.processes import run_until_signalled

    def run() -> int:
        from simspec.cli import main as command

        return command(arguments)

    return run_until_signalled(run)


def _write(text: str) -> int:
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        from simspec.processes import finish

        return finish(error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
