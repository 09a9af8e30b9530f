"""A learner without torch: says what `python -m training learn --json` says, and writes the card of
a model.

Set `TVBRDF_WORKER` to this file.  It takes `TVBRDF_STUB_SECONDS`, lists what it was given to learn
from in the description of its model, and, told to `fail` by a file of that name among it, fails.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from pathlib import Path

# The worker is started in the folder that holds model_runtime.
sys.path.insert(0, str(Path.cwd()))

from model_runtime.messages import Done, Failed, Message, Notice, Progress, Reply
from tests.model_bytes import CARD, model_bytes

SOURCE = "Learned from a stub. Encoder: as always."


def say(message: Message) -> None:
    print(Reply(message, "learn").line(), flush=True)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("verb", choices=("learn",))
    parser.add_argument("source", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    for name in ("name", "title", "process", "description"):
        parser.add_argument(f"--{name}", default="")
    parser.add_argument("--json", action="store_true", required=True)
    given = parser.parse_args()
    cancelled = threading.Event()
    threading.Thread(target=lambda: sys.stdin.readline() and cancelled.set(), daemon=True).start()
    seconds = float(os.environ.get("TVBRDF_STUB_SECONDS", "0.2"))
    for step in range(10):
        say(Progress("Learning", step / 10))
        if cancelled.wait(seconds / 10):
            say(Failed("cancelled", "Canceled.", ""))
            os._exit(3)
    files = sorted(each.name for each in given.source.iterdir())
    if "fail.txt" in files:
        say(Failed("input", "It shows no two states to learn from.", "Choose another."))
        os._exit(1)
    card = {"name": given.name, "title": given.title, "process": given.process}
    card |= {"description": " ".join(files), "source": SOURCE, "warnings": []}
    given.output.write_bytes(model_bytes({**CARD, **card}))
    say(Notice("The stub knows no height."))
    say(Done(card))
    os._exit(0)


if __name__ == "__main__":
    main()
