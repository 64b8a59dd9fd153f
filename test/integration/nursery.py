"""Python with all nodes loaded, forked for each executable that a test starts: it begins at once instead of in 2 s.

Orders come as lines of JSON on standard input, each answered by one line: what to start by the number of its process,
``{"poll": number}`` by its exit code, or null while it runs. Nothing of ROS runs before a fork. What an executable of
its own does besides, to load and to leave Python, is seen where each is started and told to stop as users do.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import traceback
from importlib import import_module

from mbpam_ros.nodes.start import EXECUTABLES, start


def become(argv: list[str], environment: dict[str, str], output: str, errors: str) -> None:
    """Do what ``python -m mbpam_ros.nodes`` does, and end."""
    code = 1
    try:
        os.environ.clear()
        os.environ.update(environment)
        for descriptor, path in ((1, output), (2, errors)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), descriptor)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.argv = argv
        code = start(argv[0])
    except SystemExit as ended:
        code = ended.code
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code or 0)


def poll(number: int) -> int | None:
    """Return the exit code of a process that has ended."""
    ended, status = os.waitpid(number, os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if ended else None


if __name__ == "__main__":
    for executable in EXECUTABLES:
        import_module(f"mbpam_ros.nodes.{executable}")
    gc.freeze()  # what is shared stays so
    for line in sys.stdin:
        order = json.loads(line)
        if "poll" in order:
            answer = poll(order["poll"])
        else:
            answer = os.fork()
            if answer == 0:
                become(**order)
        print(json.dumps(answer), flush=True)
