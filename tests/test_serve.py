"""The worker's protocol, against a real child process."""

from __future__ import annotations

import itertools
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

from model_runtime.contract import AgeRequest

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


class Child:
    """A worker, spoken to by hand."""

    def __init__(self, *arguments: str, seconds: float = 0.1, worker: Path = STUB) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(worker), "serve", *arguments],
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
        ({"sparse": float("nan")}, "sparse"),
        ({"sparse": "yes"}, "sparse"),
        ({"quality": "best"}, "draft, balanced, exact"),
        ({"temporal_model": "magic"}, "lstm_latents"),
        ({"format": "png"}, "principled-exact"),
        ({"onset": 3}, "onset"),
        ({"device": 0}, "device"),
        ({"device": "gpu"}, "cuda:N"),
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
    error = child.answers(1)[-1]
    assert error["code"] == "input"
    assert error["hint"] == "Check the path."


def test_a_failure_of_the_program_goes_to_stderr_with_its_traceback(child: Child, tmp_path: Path):
    # The stub cannot make a folder below a file: an OSError that it does not expect.
    (tmp_path / "file").write_text("")
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, output=str(tmp_path / "file" / "x"))})
    error = child.answers(1)[-1]
    assert error["code"] == "internal"
    assert "Traceback" not in error["message"] + error["hint"]
    assert "FileExistsError" in error["details"]
    child.send({"id": 2, "verb": "shutdown"})
    assert "Traceback" in child.process.communicate(timeout=10)[1]


@pytest.mark.parametrize(
    "line",
    [
        b"no json",
        b"[]",
        b"7",
        b"null",
        b'{"id": 1}',
        b'{"verb": "info"}',
        b'{"id": 1, "verb": "sing"}',
        b'{"id": 1, "verb": null}',
        b'{"id": 1, "verb": ["age"]}',
        b'{"id": [1], "verb": "info"}',
        b'{"id": NaN, "verb": "info"}',
        b'{"id": {}, "verb": "cancel"}',
        b'{"id": 1, "verb": "info", "args": []}',
        b'{"id": 1, "verb": "info", "args": 3}',
        b'{"id": 1, "verb": "info", "args": "x"}',
        b'{"id": 1, "verb": "info", "args": false}',
        b"[" * 200_000,
        b'{"id": 1, "verb": "info", "args": ' + b'{"a":' * 200_000,
        b'{"id": ' + b"9" * 5000 + b', "verb": "info"}',
        b"x" * (5 << 20),
        b'{"id": 1, "verb": "info", "args": {"ntm": "' + b"x" * (1 << 20) + b'"}}',
        b'{"id": 1, "verb": "info", "args": {"ntm": "caf\xe9"}}',
        b"\xff\xfe\x00",
        b"\x00",
        b"\x1b[2J",
    ],
)
def test_what_is_no_request_is_answered_and_survived(child: Child, line: bytes):
    child.process.stdin.buffer.write(line + b"\n")
    child.process.stdin.flush()
    reply = child.reply()
    assert (reply["type"], reply["code"]) == ("error", "protocol")
    assert len(reply["message"]) < 1000 and reply["message"].isprintable()
    child.send({"id": 5, "verb": "info"})
    assert child.answers(5)[-1]["type"] == "done"


@pytest.mark.parametrize(
    "wrong",
    [
        *(5, [], {}, True, 1e999),
        *("a\0b.safetensors", "\udce9", "/", "x/" * 9999, "x" * 300 + ".safetensors"),
    ],
    ids=lambda wrong: ascii(wrong)[:20],
)
def test_a_wrong_model_to_tell_of_is_answered_and_survived(child: Child, wrong: object):
    child.send({"id": 4, "verb": "info", "args": {"ntm": wrong}})
    assert child.answers(4)[-1]["type"] == "error"
    child.send({"id": 5, "verb": "info"})
    assert child.answers(5)[-1]["type"] == "done"


WRONG = (None, 5, -1, 1.5, True, [], {}, "", "\0", "\udce9", float("nan"), float("inf"), 10**300)


@pytest.mark.parametrize("setting", sorted(vars(AgeRequest)["__dataclass_fields__"]))
def test_no_setting_of_a_wrong_kind_ends_the_worker(child: Child, tmp_path: Path, setting: str):
    for number, wrong in enumerate(WRONG):
        if setting == "output" and wrong == "\udce9":
            continue  # a name like any other, in the current folder
        args = age(tmp_path, frames=1) | {setting: wrong}
        child.send({"id": number, "verb": "age", "args": args})
        assert child.answers(number)[-1]["type"] in ("done", "error")
    child.send({"id": "last", "verb": "info"})
    assert child.answers("last")[-1]["type"] == "done"


@pytest.mark.parametrize("args", [{"id": 99}, {"id": [1]}, {"id": None}, {}])
def test_cancel_of_what_does_not_run_is_an_error(child: Child, args: dict):
    child.send({"id": 2, "verb": "cancel", "args": args})
    (error,) = child.answers(2)
    assert error["code"] == "usage"


def test_signs_of_life_come_while_it_is_busy_and_only_then(tmp_path: Path):
    child = Child(seconds=5)
    messages = [child.message()]
    child.send({"id": 1, "verb": "age", "args": age(tmp_path, frames=2)})
    while messages[-1]["type"] != "done":
        messages.append(child.message() | {"at": time.monotonic()})
    assert [message["type"] for message in messages].index("loaded") < 4
    beats = [message["at"] for message in messages if message["type"] == "alive"]
    assert len(beats) >= 2
    assert max(b - a for a, b in itertools.pairwise(beats)) < 4
    time.sleep(3)
    child.send({"id": 2, "verb": "shutdown"})
    out, _ = child.process.communicate(timeout=10)
    idle = [json.loads(line)["type"] for line in out.splitlines()]
    assert idle.count("alive") <= 1


@pytest.mark.parametrize(
    "raised",
    [
        "MemoryError()",
        'RuntimeError("DefaultCPUAllocator: can\'t allocate memory: you tried 9 bytes")',
        "type('OutOfMemoryError', (RuntimeError,), {})('CUDA out of memory')",
    ],
)
def test_running_out_of_memory_is_said_and_survived(tmp_path: Path, raised: str):
    (tmp_path / "worker.py").write_text(
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
        "from tests import stub_worker\n"
        f"def age(request, reporter): raise {raised}\n"
        "stub_worker.stand_in(age)\n"
        "sys.exit(stub_worker.main())\n"
    )
    child = Child(worker=tmp_path / "worker.py")
    child.reply()
    child.send({"id": 1, "verb": "age", "args": age(tmp_path)})
    (error,) = child.answers(1)
    assert (error["code"], error["message"]) == ("memory", "There is not enough memory.")
    child.send({"id": 5, "verb": "info"})
    assert child.answers(5)[-1]["type"] == "done"
    child.process.kill()
    child.process.communicate()


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
