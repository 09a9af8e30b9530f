"""A worker that has left or stands still: noticed, said, and nobody else's end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import sigpipe_worker
from tests.scripted_worker import DONE, LOADED, READY, REQUESTED, all_of
from tests.test_serve import lives
from tests.test_worker import request
from tvbrdf.tvbrdf_addon import worker as worker_module
from tvbrdf.tvbrdf_addon.errors import WorkerError
from tvbrdf.tvbrdf_addon.worker import Done, Launch, Progress, Worker, run

ROOT = Path(__file__).resolve().parents[1]


def test_a_worker_that_stands_still_is_noticed(worker: Worker, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")
    monkeypatch.setattr(worker_module, "SILENCE_SECONDS", 3.0)
    stopped = []

    def stop(message: object) -> None:
        if isinstance(message, Progress) and not stopped:
            os.kill(worker.pid, signal.SIGSTOP)
            stopped.append(worker._process)

    with pytest.raises(WorkerError, match="no sign of life for 3 seconds") as caught:
        all_of(run(worker, "age", request(tmp_path, frames=600)), stop)
    assert caught.value.code == "silent"
    assert not worker.alive
    assert stopped[0].returncode == -signal.SIGKILL
    # The next run starts another one.
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.1")
    assert isinstance(all_of(run(worker, "age", request(tmp_path)))[-1], Done)


def test_a_worker_that_stood_still_before_it_was_asked_is_noticed(
    worker: Worker, tmp_path: Path, monkeypatch
):
    monkeypatch.setattr(worker_module, "SILENCE_SECONDS", 0.5)
    all_of(run(worker, "age", request(tmp_path)))
    os.kill(worker.pid, signal.SIGSTOP)
    with pytest.raises(WorkerError, match="no sign of life"):
        all_of(run(worker, "age", request(tmp_path)))


def test_signs_of_life_are_enough_however_long_a_stage_takes(script, monkeypatch):
    monkeypatch.setattr(worker_module, "SILENCE_SECONDS", 0.4)
    slow = script(
        READY
        + LOADED
        + REQUESTED
        + """
for _ in range(12):
    time.sleep(0.1)
    print('{"type": "alive"}', flush=True)
"""
        + DONE
    )
    assert all_of(run(slow, "age", {})) == [Done({"fine": True})]


def test_loading_torch_may_take_longer_than_silence(script, monkeypatch):
    monkeypatch.setattr(worker_module, "SILENCE_SECONDS", 0.2)
    loading = script(READY + "time.sleep(1)\n" + LOADED + REQUESTED + DONE)
    assert all_of(run(loading, "age", {})) == [Done({"fine": True})]


def test_a_computer_that_slept_is_not_a_worker_that_is_silent(script, monkeypatch):
    """The clock jumps by an hour between two looks, as Blender's may after a suspend."""
    clock = time.monotonic
    jumps = iter(range(0, 5 * 3600, 3600))
    jumped = [0]
    monkeypatch.setattr(worker_module.time, "monotonic", lambda: clock() + jumped[0])
    slow = script(READY + LOADED + REQUESTED + "time.sleep(0.5)\n" + DONE)
    heard = []
    for message in run(slow, "age", {}):
        heard.append(message)
        jumped[0] = next(jumps, jumped[0])
        time.sleep(0.02)
    assert jumped[0] == 4 * 3600
    assert heard[-1] == Done({"fine": True})


@pytest.mark.skipif(not hasattr(signal, "SIGPIPE"), reason="Windows has no SIGPIPE")
@pytest.mark.parametrize("way", [way for way in sigpipe_worker.WAYS if way != "unguarded"])
def test_a_process_that_sigpipe_ends_survives_its_worker(way: str, tmp_path: Path):
    lost = lose_worker(way, tmp_path)
    assert lost.returncode == 0, lost.stderr
    assert lost.stdout.endswith("survived\n")


@pytest.mark.skipif(not hasattr(signal, "SIGPIPE"), reason="Windows has no SIGPIPE")
def test_that_process_would_not_survive_any_other_write(tmp_path: Path):
    assert lose_worker("unguarded", tmp_path).returncode == -signal.SIGPIPE


def lose_worker(way: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.sigpipe_worker", way, str(folder)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )


def test_a_large_request_to_a_deaf_worker_makes_nobody_wait(script):
    deaf = script(READY + "time.sleep(60)")
    steps = run(deaf, "age", {"input": "x" * (1 << 23)})
    while deaf.pid is None or deaf._last_id == 0:
        started = time.perf_counter()
        next(steps)
        assert time.perf_counter() - started < 1
        time.sleep(0.01)
    deaf.stop(at_once=True)
    assert deaf.pid is None


def test_the_real_worker_behind_a_script_ends_with_it(tmp_path: Path):
    wrapper, told = tmp_path / "python", tmp_path / "pid"
    sleep = f"{sys.executable} -c 'import time; time.sleep(60)'"
    wrapper.write_text(
        f"#!/bin/sh\n{sleep} &\necho $! > {told}.part\nmv {told}.part {told}\nwait\n"
    )
    wrapper.chmod(0o755)
    worker = Worker(Launch(runtime=ROOT, interpreter=str(wrapper)))
    worker.start()
    while not told.exists():
        time.sleep(0.01)
    worker.stop(at_once=True)
    deadline = time.monotonic() + 5
    while lives(int(told.read_text())) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not lives(int(told.read_text()))
