"""The start of the command line: answers ``--help`` from a stored text, and leaves the rest to ``simspec.cli``.

Building the help from the commands takes longer than anything else about asking for it; ``help.txt`` is made from them by
``python -m simspec.cli --write-help``, and a test fails when it is stale. Only what every Python has loaded is imported.
"""

import sys


def main() -> int:
    """Run the command line; the exit code."""
    arguments = sys.argv[1:]
    if not arguments or arguments in (["--help"], ["-h"], ["help"]):
        with open(__file__.removesuffix("__main__.py") + "help.txt", encoding="utf-8") as file:
            text = file.read()
        sys.stdout.write(text)
        return 0
    from simspec.cli import main as run

    return run(arguments)


if __name__ == "__main__":
    sys.exit(main())
