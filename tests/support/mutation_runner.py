"""Renders mutants one after the other, in this process, and says what came of each.

    python -W error tests/support/mutation_runner.py FOLDER SCENE [FOLDER SCENE ...]

Prints a line of JSON for each: the exit code, what was said and the seconds of processor time. A
mutant that takes more than ``LIMIT`` of them ends the process by SIGPROF, whatever code it is in;
memory is held to ``MEMORY``.
"""

from __future__ import annotations

import io
import json
import os
import resource
import signal
import sys
import time
import traceback

LIMIT = 30.0
MEMORY = 4 << 30
OPTIONS = ("--width", "24", "--height", "16", "--samples", "1", "--frames", "1", "-o", "out.exr")


def run(folder: str, scene: str) -> dict[str, object]:
    from mbinterval import cli

    os.chdir(folder)
    kept, sys.stderr = sys.stderr, io.StringIO()
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    started = time.process_time()
    try:
        code = cli.main(["render", scene, *OPTIONS, "-v"])
    except BaseException:
        traceback.print_exc()
        code = -1
    finally:
        seconds = time.process_time() - started
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        said, sys.stderr = sys.stderr.getvalue(), kept
    return {"code": code, "said": said, "seconds": seconds}


def main(names: list[str]) -> None:
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    results = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries that print
    for folder, scene in zip(names[::2], names[1::2], strict=True):
        print(json.dumps(run(folder, scene)), file=results, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
