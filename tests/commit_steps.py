"""Commits in forks of this process, which are killed or hindered at one operation each.

python -S commit_steps.py WHAT TEMPLATE PLACES: copies the folder TEMPLATE, in which `aged` may lie,
and lets a fork stage three files for `aged` (`beside` it or `within`) and commit them, or `recover`
what lies there.  The fork meets its end (`kill`), an error (`fail`) or errors from then on
(`broken`) at its first operation on the file system; another fork, on another copy, at its second;
and so on until one comes to its end.  With `together` there is one copy, and a fork for each of
PLACES, all at once and unhindered.  Prints a list of copies and their forks' exit statuses.

Standard library only: a fork takes milliseconds.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import sys
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from model_runtime.contract import REPORT, staging_places
from model_runtime.output import commit, staging

OPERATIONS = ("os.", "fcntl.", "open")
# Exit statuses of a fork: it came to its end before its time; with something in between; it could
# not; a traceback.
COMPLETE, HINDERED, FAILED, UNEXPECTED = 0, 10, 11, 12


def fill(staged: Path, value: str, frames: int) -> list[str]:
    names = [f"kd_{k:04d}.exr" for k in range(1, frames + 1)]
    for name in names:
        (staged / name).write_text(value)
    report = {"value": value, "files": {"kd": names}}
    (staged / REPORT).write_text(json.dumps(report))
    return names


def hinder(what: str, at: int) -> list[str]:
    """Let this process meet `what` at its `at`-th operation from now on; returns those so far."""
    operations: list[str] = []

    def meet(event: str, _arguments: object) -> None:
        if not event.startswith(OPERATIONS) or event == "os.kill":
            return
        operations.append(event)
        if what == "kill" and len(operations) == at:
            os.kill(os.getpid(), signal.SIGKILL)
        if (what == "fail" and len(operations) == at) or (
            what == "broken" and len(operations) >= at
        ):
            raise OSError(5, "Input/output error")

    sys.addaudithook(meet)
    return operations


def attempt(what: str, at: int, folder: Path, place: str, value: str, frames: int) -> int:
    """Commit or recover in this process, a fork; its exit status."""
    try:
        if place == "recover":
            operations = hinder(what, at)
            commit.recover(folder)
        else:
            if place == "within":
                staging.staging_places = lambda *given: (staging_places(*given)[1],) * 2
            with staging.staging(folder) as staged:
                names = fill(staged, value, frames)
                operations = hinder(what, at)
                commit.commit(staged, folder, names)
    except OSError:
        return FAILED
    except BaseException:
        traceback.print_exc()
        return UNEXPECTED
    return COMPLETE if len(operations) < at else HINDERED


def forked(*arguments) -> int:
    """The process id of a fork that makes an attempt."""
    process = os.fork()
    if process == 0:
        os._exit(attempt(*arguments))
    return process


def main(what: str, template: Path, *places: str) -> None:
    outcomes: list[tuple[str, int]] = []

    def copy() -> Path:
        return Path(shutil.copytree(template, f"{template}-{what}-{len(outcomes)}")) / "aged"

    def ended(process: int) -> int:
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])

    if what == "together":
        folder = copy()
        runs = [forked(what, 1, folder, each, f"v{k}", 20 + k) for k, each in enumerate(places)]
        outcomes += [(str(folder), ended(run)) for run in runs]
    else:
        status = HINDERED
        for at in itertools.count(1):
            folder = copy()
            status = ended(forked(what, at, folder, places[0], "new", 3))
            outcomes.append((str(folder), status))
            if status in (COMPLETE, UNEXPECTED):
                break
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *sys.argv[3:])
