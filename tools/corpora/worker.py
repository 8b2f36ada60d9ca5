"""A process that answers for one file after the other, with all that takes long to start kept: imports, engines, meshes.

    python worker.py DESCRIPTOR

It reads a request in each line of its standard input ({"stage", "file", "folders", "engines"}) and writes a line of JSON to the
descriptor. The caller bounds its time, and starts another worker when it is gone.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
import traceback

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

MEMORY = 6 * 2**30
"""Bytes of data of this process."""


def main() -> None:
    """Answer every request."""
    answers = os.fdopen(int(sys.argv[1]), "w", encoding="utf-8")
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    from stages import STAGES, Kept

    with Kept() as kept:
        for line in sys.stdin:
            request = json.loads(line)
            wall, used = time.perf_counter(), time.process_time()
            try:
                answer = STAGES[request["stage"]](request["file"], request["folders"], kept, request["engines"])
            # any other exception is a result: an import may only end with an error with a place
            except Exception:
                answer = {"crash": traceback.format_exc()[-2000:]}
            answer["seconds"] = round(time.perf_counter() - wall, 3)
            answer["cpu"] = round(time.process_time() - used, 3)
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
