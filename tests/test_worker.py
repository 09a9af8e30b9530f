"""The worker as Blender sees it, without Blender: every way in which a child can disappoint."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tvbrdf.tvbrdf_addon import process as process_module
from tvbrdf.tvbrdf_addon import worker as worker_module
from tvbrdf.tvbrdf_addon.errors import WorkerError
from tvbrdf.tvbrdf_addon.worker import Done, Launch, Notice, Progress, Worker, run

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


@pytest.fixture(autouse=True)
def _no_other_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TVBRDF_WORKER", raising=False)
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.1")


@pytest.fixture
def worker() -> Iterator[Worker]:
    worker = Worker(Launch(runtime=ROOT, interpreter=str(STUB)))
    yield worker
    worker.stop()


@pytest.fixture
def script(tmp_path: Path) -> Iterator[Callable[[str], Worker]]:
    """A worker made of a few lines of Python."""
    workers = []

    def make(code: str) -> Worker:
        path = tmp_path / "worker.py"
        path.write_text(textwrap.dedent(code))
        workers.append(Worker(Launch(runtime=ROOT, interpreter=str(path))))
        return workers[-1]

    yield make
    for worker in workers:
        worker.stop()


def request(tmp_path: Path, **changes: object) -> dict:
    return {"input": str(tmp_path), "ntm": "rust", "output": str(tmp_path / "out")} | changes


def all_of(messages: Iterator, each: Callable[[object], None] = lambda message: None) -> list:
    """Every message of a run, as the blocking path takes them; `each` hears them as they come."""
    heard = []
    for message in messages:
        if message is None:
            time.sleep(0.01)
        else:
            heard.append(message)
            each(message)
    return heard


READY = 'import json, sys, time\nprint(json.dumps({"type": "ready", "protocol": 1}), flush=True)\n'


def test_a_run_ends_with_its_result(worker: Worker, tmp_path: Path):
    *on_the_way, done = all_of(run(worker, "age", request(tmp_path, frames=5)))
    assert isinstance(done, Done)
    assert done.result["frames"] == 5
    assert any(isinstance(message, Notice) for message in on_the_way)
    assert [m.fraction for m in on_the_way if isinstance(m, Progress)][-1] == 1.0


def test_the_worker_stays_warm_between_runs(worker: Worker, tmp_path: Path):
    all_of(run(worker, "age", request(tmp_path)))
    pid = worker.pid
    all_of(run(worker, "age", request(tmp_path)))
    assert worker.pid == pid


def test_looking_at_it_never_takes_long(worker: Worker, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "1")
    longest, last = 0.0, time.perf_counter()
    for _ in run(worker, "age", request(tmp_path)):
        longest = max(longest, time.perf_counter() - last)
        time.sleep(0.02)
        last = time.perf_counter()
    # Starting the process is the longest; a frame at 20 fps is 50 ms.
    assert longest < 0.25


def test_cancel(worker: Worker, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")
    heard: list[object] = []
    steps = run(worker, "age", request(tmp_path, frames=600), cancelled=lambda: len(heard) > 3)
    with pytest.raises(WorkerError) as caught:
        all_of(steps, heard.append)
    assert caught.value.code == "cancelled"
    assert worker.alive
    assert list(tmp_path.iterdir()) == []


def test_letting_go_of_a_run_cancels_it(worker: Worker, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")
    steps = run(worker, "age", request(tmp_path, frames=600))
    while not isinstance(next(steps), Progress):
        time.sleep(0.01)
    steps.close()
    # The next one is told that the worker is busy only until the first has noticed.
    deadline = time.monotonic() + 10
    while list(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_deaf_to_cancel_is_killed(script, monkeypatch):
    monkeypatch.setattr(worker_module, "CANCEL_SECONDS", 0.2)
    monkeypatch.setattr(process_module, "SHUTDOWN_SECONDS", 0.2)
    deaf = script(READY + "time.sleep(60)")
    with pytest.raises(WorkerError) as caught:
        all_of(run(deaf, "age", {}, cancelled=lambda: True))
    assert caught.value.code == "cancelled"
    assert not deaf.alive


def test_kill_9_in_the_middle_of_a_run(worker: Worker, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")

    def kill(_message: object) -> None:
        if worker.alive:
            os.kill(worker.pid, signal.SIGKILL)
            worker._process.wait()

    with pytest.raises(WorkerError, match="killed by signal 9") as caught:
        all_of(run(worker, "age", request(tmp_path, frames=600)), kill)
    assert caught.value.code == "died"
    assert "memory" in caught.value.hint
    # The next run starts another one.
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.1")
    assert isinstance(all_of(run(worker, "age", request(tmp_path)))[-1], Done)


def test_a_worker_that_dies_while_idle_is_replaced(worker: Worker, tmp_path: Path):
    all_of(run(worker, "info", {}))
    pid = worker.pid
    os.kill(pid, signal.SIGKILL)
    worker._process.wait()
    assert isinstance(all_of(run(worker, "age", request(tmp_path)))[-1], Done)
    assert worker.pid != pid


def test_a_worker_that_leaves_as_the_request_comes_is_replaced(script, tmp_path: Path):
    # The first time it is idle and goes; the second time it answers.
    leaving = script(
        READY
        + f"""
from pathlib import Path
seen = Path({str(tmp_path / "seen")!r})
line = sys.stdin.readline()
if not seen.exists():
    seen.write_text("")
    sys.exit(0)
reply = {{"id": json.loads(line)["id"], "type": "done", "result": {{"second": True}}}}
print(json.dumps(reply), flush=True)
sys.stdin.readline()
"""
    )
    assert all_of(run(leaving, "age", {})) == [Done({"second": True})]


def test_a_crash_on_start_shows_the_last_words(script):
    broken = script("import a_module_that_is_not_there")
    with pytest.raises(WorkerError) as caught:
        all_of(run(broken, "age", {}))
    assert "a_module_that_is_not_there" in caught.value.hint
    assert "Traceback" not in str(caught.value)
    assert "Traceback" in caught.value.details


def test_a_missing_interpreter_is_named(tmp_path: Path):
    worker = Worker(Launch(runtime=ROOT, interpreter=str(tmp_path / "nothing")))
    with pytest.raises(WorkerError, match="nothing"):
        all_of(run(worker, "age", {}))


def test_an_interpreter_that_is_no_program_is_named(tmp_path: Path):
    path = tmp_path / "picture.png"
    path.write_bytes(b"\x89PNG")
    path.chmod(0o755)
    worker = Worker(Launch(runtime=ROOT, interpreter=str(path)))
    with pytest.raises(WorkerError, match=r"picture\.png"):
        all_of(run(worker, "age", {}))


def test_another_protocol_is_refused(script):
    newer = script(READY.replace("1}", "2}") + "time.sleep(60)")
    with pytest.raises(WorkerError, match="protocol 2") as caught:
        all_of(run(newer, "age", {}))
    assert caught.value.code == "protocol"
    assert not newer.alive


def test_silence_is_not_waited_for_forever(script, monkeypatch):
    monkeypatch.setattr(worker_module, "START_SECONDS", 0.2)
    silent = script("import time\ntime.sleep(60)")
    with pytest.raises(WorkerError, match="has not answered"):
        all_of(run(silent, "age", {}))
    assert not silent.alive


def test_garbage_between_the_messages_is_ignored(script):
    noisy = script(
        READY
        + """
request = json.loads(sys.stdin.readline())
for line in ("hello", "[]", "17", "{", '{"id": 1, "type": "sing"}', '{"id": 99, "type": "done"}'):
    print(line)
sys.stdout.buffer.write(bytes(range(128, 256)) + b"\\n")
print('{"id": 1, "type": "progress", "stage": 3, "fraction": "much"}')
print(json.dumps({"id": request["id"], "type": "done", "result": {"fine": True}}), flush=True)
sys.stdin.readline()
"""
    )
    assert all_of(run(noisy, "age", {}))[-1] == Done({"fine": True})


def test_a_flood_on_stderr_blocks_nobody(script):
    noisy = script(
        READY
        + """
request = json.loads(sys.stdin.readline())
for number in range(20000):
    print("a line of forty letters, more or less, ", number, file=sys.stderr)
print(json.dumps({"id": request["id"], "type": "done", "result": {}}), flush=True)
sys.stdin.readline()
"""
    )
    assert all_of(run(noisy, "age", {}))[-1] == Done({})


def test_an_error_keeps_the_workers_code_message_and_hint(worker: Worker, tmp_path: Path):
    with pytest.raises(WorkerError) as caught:
        all_of(run(worker, "age", request(tmp_path, input=str(tmp_path / "no"))))
    assert caught.value.code == "input"
    assert caught.value.hint == "Check the path."


def test_stop_ends_the_process_and_can_be_repeated(worker: Worker):
    all_of(run(worker, "info", {}))
    process = worker._process
    worker.stop()
    worker.stop()
    assert process.returncode == 0
    assert worker.pid is None


def test_the_workers_python_is_not_the_users(tmp_path: Path, monkeypatch):
    """Neither PYTHONPATH nor the user's site-packages lead in; the extension's packages do."""
    users, ours = tmp_path / "users", tmp_path / "ours"
    for folder, word in ((users, "users"), (ours, "extension")):
        folder.mkdir()
        (folder / "whose.py").write_text(f"WORD = {word!r}")
    (users / "only_the_users.py").write_text("")
    package = tmp_path / "runtime" / "model_runtime"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text(
        "import importlib.util, json, sys\nimport whose\n"
        "print(json.dumps({'whose': whose.WORD, 'arguments': sys.argv[1:], "
        "'leak': importlib.util.find_spec('only_the_users') is not None}))"
    )
    monkeypatch.setenv("PYTHONPATH", str(users))
    launch = Launch(runtime=tmp_path / "runtime", site_packages=(ours,), idle_minutes=3)
    out = subprocess.run(launch.command(), capture_output=True, text=True, check=True).stdout
    assert json.loads(out) == {
        "whose": "extension",
        "arguments": ["serve", "--idle-minutes", "3"],
        "leak": False,
    }


def test_a_chosen_python_keeps_its_own_packages(tmp_path: Path):
    """A CUDA build of torch elsewhere must not be hidden by the wheels of the extension."""
    launch = Launch(runtime=ROOT, site_packages=(tmp_path,), interpreter=sys.executable)
    command = launch.command()
    assert command[0] == sys.executable
    assert str(tmp_path) not in " ".join(command)


def test_the_preference_goes_before_the_environment(monkeypatch):
    monkeypatch.setenv("TVBRDF_WORKER", str(STUB))
    assert Launch(runtime=ROOT).command()[:2] == [sys.executable, str(STUB)]
    assert Launch(runtime=ROOT, interpreter=sys.executable).command()[1] == "-c"
