"""The worker's protocol, against a real child process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


class Child:
    """A worker, spoken to by hand."""

    def __init__(self, *arguments: str, seconds: float = 0.1) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(STUB), "serve", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=os.environ | {"TVBRDF_STUB_SECONDS": str(seconds)},
        )

    def send(self, request: object) -> None:
        line = request if isinstance(request, str) else json.dumps(request)
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def message(self) -> dict[str, Any]:
        return json.loads(self.process.stdout.readline())

    def reply(self) -> dict[str, Any]:
        """The next message that is no sign of life."""
        while (message := self.message())["type"] in ("alive", "loaded"):
            pass
        return message

    def answers(self, request_id: object) -> list[dict[str, Any]]:
        """All replies to a request, up to the one that ends it."""
        replies = []
        while not replies or replies[-1]["type"] not in ("done", "error"):
            reply = self.reply()
            if reply["id"] == request_id:
                replies.append(reply)
        return replies


@pytest.fixture
def child() -> Iterator[Child]:
    child = Child()
    assert child.reply()["type"] == "ready"
    yield child
    child.process.kill()
    child.process.communicate()


def age(tmp_path: Path, **changes: object) -> dict[str, Any]:
    return {"input": str(tmp_path), "ntm": "rust", "output": str(tmp_path / "out")} | changes


def test_ready_comes_first_and_says_which_protocol():
    child = Child()
    ready = child.reply()
    assert ready["type"] == "ready"
    assert ready["protocol"] == 1
    assert isinstance(ready["version"], str)
    child.process.kill()
    child.process.communicate()


def test_age_reports_progress_warnings_and_its_result(child: Child, tmp_path: Path):
    child.send({"id": 7, "verb": "age", "args": age(tmp_path, frames=4)})
    *on_the_way, done = child.answers(7)
    assert done["type"] == "done"
    assert done["result"] == json.loads((tmp_path / "out" / "aged.json").read_text())
    fractions = [m["fraction"] for m in on_the_way if m["type"] == "progress"]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert [m["message"] for m in on_the_way if m["type"] == "warning"]


def test_only_messages_come_out_of_stdout(child: Child, tmp_path: Path):
    # The stub prints from Python and from below it; `reply` fails on any line that is not JSON.
    child.send({"id": 1, "verb": "age", "args": age(tmp_path)})
    assert child.answers(1)[-1]["type"] == "done"
    child.send({"id": 2, "verb": "shutdown"})
    out, err = child.process.communicate(timeout=10)
    messages = [json.loads(line) for line in out.splitlines()]
    assert [message["id"] for message in messages if message["type"] != "alive"] == [2]
    assert "a library prints this" in err
    assert "and this, from C" in err


def test_cancel_ends_a_run_and_leaves_the_worker_warm(tmp_path: Path):
    child = Child(seconds=30)
    child.reply()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "earlier.txt").write_text("kept")
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, frames=600)})
    while child.reply()["type"] != "progress":
        pass
    child.send({"id": 2, "verb": "cancel", "args": {"id": 1}})
    error = child.answers(1)[-1]
    assert error["code"] == "cancelled"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "earlier.txt").read_text() == "kept"
    child.send({"id": 3, "verb": "info"})
    assert child.answers(3)[-1]["type"] == "done"
    child.process.kill()
    child.process.communicate()


def test_cancel_of_another_id_changes_nothing(child: Child, tmp_path: Path):
    child.send({"id": 1, "verb": "age", "args": age(tmp_path)})
    child.send({"id": 2, "verb": "cancel", "args": {"id": 99}})
    assert child.answers(1)[-1]["type"] == "done"


def test_a_second_run_is_told_that_the_worker_is_busy(tmp_path: Path):
    child = Child(seconds=30)
    child.reply()
    child.send({"id": 1, "verb": "age", "args": age(tmp_path)})
    child.send({"id": 2, "verb": "age", "args": age(tmp_path)})
    (busy,) = child.answers(2)
    assert busy["code"] == "busy"
    child.send({"id": 3, "verb": "cancel"})
    child.process.kill()
    child.process.communicate()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"frames": 0}, "--frames"),
        ({"frames": -3}, "--frames"),
        ({"frames": 2.5}, "--frames"),
        ({"frames": True}, "--frames"),
        ({"size": 0}, "--size"),
        ({"seed": -1}, "--seed"),
        ({"tolerance": 0}, "--tolerance"),
        ({"tolerance": float("nan")}, "--tolerance"),
        ({"tolerance": float("inf")}, "--tolerance"),
        ({"quality": "best"}, "draft, balanced, exact"),
        ({"temporal_model": "magic"}, "lstm_latents"),
        ({"format": "png"}, "principled-exact"),
        ({"onset": 3}, "onset"),
        ({"ntm": None}, "ntm"),
        ({"output": ""}, "output"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_wrong_setting_is_named(child: Child, tmp_path: Path, changes: dict, word: str):
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, **changes)})
    (error,) = child.answers(1)
    assert error["code"] == "usage"
    assert word in error["message"] + error["hint"]


def test_a_failure_with_a_reason_keeps_its_code_and_hint(child: Child, tmp_path: Path):
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, input=str(tmp_path / "no"))})
    (error,) = child.answers(1)
    assert error["code"] == "input"
    assert error["hint"] == "Check the path."


def test_a_failure_of_the_program_goes_to_stderr_with_its_traceback(child: Child, tmp_path: Path):
    # The stub cannot make a folder below a file: an OSError that it does not expect.
    (tmp_path / "file").write_text("")
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, output=str(tmp_path / "file" / "x"))})
    error = child.answers(1)[-1]
    assert error["code"] == "internal"
    assert "Traceback" not in error["message"] + error["hint"]
    child.send({"id": 2, "verb": "shutdown"})
    assert "Traceback" in child.process.communicate(timeout=10)[1]


@pytest.mark.parametrize("line", ["no json", "[]", "7", '{"id": 1}', '{"id": 1, "verb": "sing"}'])
def test_what_is_no_request_is_answered_and_survived(child: Child, line: str):
    child.send(line)
    assert child.reply()["code"] == "protocol"
    child.send({"id": 5, "verb": "info"})
    assert child.answers(5)[-1]["type"] == "done"


def test_info_answers_during_a_run(tmp_path: Path):
    child = Child(seconds=30)
    child.reply()
    child.send({"id": 1, "verb": "age", "args": age(tmp_path)})
    child.send({"id": 2, "verb": "info", "args": {}})
    assert isinstance(child.answers(2)[-1]["result"], list)
    child.process.kill()
    child.process.communicate()


def test_it_ends_when_stdin_closes_even_in_the_middle_of_a_run(tmp_path: Path):
    child = Child(seconds=60)
    child.reply()
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, frames=600)})
    while child.reply()["type"] != "progress":
        pass
    child.process.stdin.close()
    child.process.stdin = None
    child.process.communicate(timeout=10)
    assert child.process.returncode == 0
    assert list(tmp_path.iterdir()) == []


def test_it_ends_when_it_has_been_idle():
    child = Child("--idle-minutes", "0.005")
    child.process.communicate(timeout=10)
    assert child.process.returncode == 0


def test_it_ends_with_a_blender_that_is_killed(tmp_path: Path):
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import subprocess, sys, time\n"
            "child = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE)\n"
            "print(child.pid, flush=True)\n"
            "time.sleep(60)",
            sys.executable,
            str(STUB),
            "serve",
        ],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    worker = int(parent.stdout.readline())
    assert json.loads(parent.stdout.readline())["type"] == "ready"
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    deadline = time.monotonic() + 10
    while lives(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not lives(worker)
    parent.stdout.close()


def lives(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    # Nobody may be there to reap it.
    return state != "Z"
