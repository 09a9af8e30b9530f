"""Loses its worker in one way, in a process that SIGPIPE ends, as Blender is.

    python -m tests.sigpipe_worker WAY FOLDER

Prints `survived` at its end.  The way `unguarded` shows that any other write would end it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import tests.conftest  # noqa: F401 (finds the extension)
from tests.scripted_worker import READY
from tvbrdf.model_runtime.messages import Ready
from tvbrdf.tvbrdf_addon.errors import WorkerError
from tvbrdf.tvbrdf_addon.worker import Done, Launch, Worker, run

ROOT = Path(__file__).resolve().parents[1]
# More than any pipe holds, so that writing it waits for a reader.
LARGE = {"input": "x" * (1 << 23)}


def worker(folder: Path, code: str) -> Worker:
    script = folder / "worker.py"
    script.write_text(code)
    return Worker(Launch(runtime=ROOT, interpreter=str(script)))


def answer(worker: Worker, args: dict) -> object:
    for message in run(worker, "info", args):
        if message is not None:
            return message
        time.sleep(0.01)
    return None


def fails(worker: Worker, args: dict) -> None:
    try:
        answer(worker, args)
    except WorkerError:
        return
    raise AssertionError("it should have failed")


def started(worker: Worker) -> Worker:
    worker.start()
    while not any(isinstance(reply.message, Ready) for reply in worker.poll()):
        time.sleep(0.01)
    return worker


def killed(folder: Path) -> None:
    """Between two runs; the next starts another."""
    stub = Worker(Launch(runtime=ROOT, interpreter=str(ROOT / "tests" / "stub_worker.py")))
    assert isinstance(answer(stub, {}), Done)
    os.kill(stub.pid, signal.SIGKILL)
    while stub.alive:
        time.sleep(0.01)
    assert isinstance(answer(stub, {}), Done)
    stub.stop()


def left(folder: Path) -> None:
    """Its time was over, just as the request came."""
    fails(worker(folder, READY), LARGE)


def crashed_while_we_wrote(folder: Path) -> None:
    fails(worker(folder, READY + "time.sleep(0.3)\nsys.exit(7)"), LARGE)


def crashed_at_start(folder: Path) -> None:
    fails(worker(folder, "import sys; sys.exit(7)"), LARGE)


def not_there(folder: Path) -> None:
    fails(Worker(Launch(runtime=ROOT, interpreter=str(folder / "nothing"))), {})


def deaf(folder: Path) -> None:
    """It never reads, so all that we say waits in the pipe when it is killed."""
    silent = started(worker(folder, READY + "time.sleep(60)"))
    silent.send("info", LARGE)
    silent.stop(at_once=True)


def closes_its_stdin(folder: Path) -> None:
    """It lives and talks, but hears nothing."""
    other = started(worker(folder, READY + "import os\nos.close(0)\ntime.sleep(60)"))
    time.sleep(0.3)
    for _ in range(3):
        other.send("cancel", {"id": 1})
        time.sleep(0.1)
    other.stop(at_once=True)


def stopped_when_dead(folder: Path) -> None:
    dead = started(worker(folder, READY))
    while dead.alive:
        time.sleep(0.01)
    dead.send("cancel", {"id": 1})
    dead.stop()


def unguarded(_folder: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""], stdin=subprocess.PIPE)
    gone.wait()
    os.write(gone.stdin.fileno(), b"x")


WAYS: dict[str, Callable[[Path], None]] = {
    way.__name__: way
    for way in (
        *(killed, left, crashed_while_we_wrote, crashed_at_start, not_there, deaf),
        *(closes_its_stdin, stopped_when_dead, unguarded),
    )
}

if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    WAYS[sys.argv[1]](Path(sys.argv[2]))
    # Time for a signal that is still on its way.
    time.sleep(0.2)
    assert signal.getsignal(signal.SIGPIPE) == signal.SIG_DFL, "others' SIGPIPE is not ours"
    assert signal.SIGPIPE not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    print("survived", flush=True)
