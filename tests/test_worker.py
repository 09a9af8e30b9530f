"""The worker as Blender sees it, without Blender: every way in which a child can disappoint."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from tests.scripted_worker import READY, all_of
from tvbrdf.tvbrdf_addon import process as process_module
from tvbrdf.tvbrdf_addon import worker as worker_module
from tvbrdf.tvbrdf_addon.errors import WorkerError
from tvbrdf.tvbrdf_addon.worker import Done, Launch, Notice, Progress, Worker, prepare, run

ROOT = Path(__file__).resolve().parents[1]


def request(tmp_path: Path, **changes: object) -> dict:
    return {"input": str(tmp_path), "ntm": "rust", "output": str(tmp_path / "out")} | changes


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


def test_one_that_was_prepared_is_not_started_again(worker: Worker, tmp_path: Path):
    prepare(worker)
    pid = worker.pid
    prepare(worker)
    assert isinstance(all_of(run(worker, "age", request(tmp_path)))[-1], Done)
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


def test_a_worker_that_always_leaves_is_started_twice(script, tmp_path: Path):
    leaving = script(
        f"with open({str(tmp_path / 'starts')!r}, 'a') as starts:\n    starts.write('x')\n"
        + READY
        + "sys.stdin.readline()"
    )
    with pytest.raises(WorkerError, match="ended") as caught:
        all_of(run(leaving, "age", {}))
    assert caught.value.code == "died"
    assert (tmp_path / "starts").read_text() == "xx"


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


def test_what_the_worker_says_can_be_shown(script):
    """Not in the words of the worker: no half characters, no terminal's codes, no million."""
    rude = script(
        READY
        + r"""
request = json.loads(sys.stdin.readline())
bad = "caf\udce9 \x1b[2J" + "x" * 100000
for reply in ({"type": "warning", "message": bad}, {"type": "error", "message": bad, "hint": bad}):
    print(json.dumps({"id": request["id"], **reply}), flush=True)
"""
    )
    heard: list[object] = []
    with pytest.raises(WorkerError) as caught:
        all_of(run(rude, "age", {}), heard.append)
    for text in (heard[0].message, caught.value.message, caught.value.hint):
        assert text.startswith(r"caf\udce9 \x1b[2Jxxx")
        assert len(text.encode()) < 2000
