"""How the worker is started: with which Python, and with nothing that lies about."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.scripted_worker import all_of
from tvbrdf.tvbrdf_addon.errors import WorkerError
from tvbrdf.tvbrdf_addon.worker import Done, Launch, Worker, run

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


@pytest.fixture(autouse=True)
def _no_other_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TVBRDF_WORKER", raising=False)


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


def test_results_are_kept_where_the_environment_says_or_else_the_extension(
    tmp_path: Path, monkeypatch
):
    monkeypatch.delenv("TVBRDF_CACHE", raising=False)
    launch = Launch(runtime=ROOT, interpreter=str(STUB), cache=tmp_path, cache_gigabytes=0.5)
    assert launch.command()[-4:] == ["--cache", str(tmp_path), "--cache-gb", "0.5"]
    monkeypatch.setenv("TVBRDF_CACHE", str(tmp_path / "farm"))
    assert launch.cache_folder == tmp_path / "farm"
    assert str(tmp_path / "farm") in launch.command()
    monkeypatch.setenv("TVBRDF_CACHE", "")
    assert launch.cache_folder is None
    assert "--cache" not in launch.command()


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


def test_whether_pytorch_came_along_is_seen_without_a_worker(tmp_path: Path):
    launch = Launch(runtime=ROOT, site_packages=(tmp_path,))
    assert not launch.has_torch
    assert Launch(runtime=ROOT, interpreter=sys.executable).has_torch  # it may
    (tmp_path / "torch").mkdir()
    assert launch.has_torch


@pytest.mark.parametrize(
    "path", ["python3", "./python3", "bin/python3", "//python3", "~no_such_user/python3"]
)
def test_a_worker_that_is_no_whole_path_is_not_run(path: str, tmp_path: Path, monkeypatch):
    """Whatever lies beside a .blend, or in the folder that Blender was started in."""
    (tmp_path / "bin").mkdir()
    for place in (tmp_path, tmp_path / "bin"):
        (place / "python3").write_text(f"#!/bin/sh\ntouch {tmp_path}/it_ran\n")
        (place / "python3").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    for launch in (Launch(runtime=ROOT, interpreter=path), Launch(runtime=ROOT)):
        monkeypatch.setenv("TVBRDF_WORKER", path)
        with pytest.raises(WorkerError, match="is not the whole path of a worker"):
            all_of(run(Worker(launch), "age", {}))
    assert not (tmp_path / "it_ran").exists()


def test_nothing_in_the_current_folder_is_imported(tmp_path: Path, monkeypatch):
    for name in ("json", "model_runtime", "torch"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'it_ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    for interpreter in ("", sys.executable):
        worker = Worker(Launch(runtime=ROOT, interpreter=interpreter))
        assert isinstance(all_of(run(worker, "info", {}))[-1], Done)
        worker.stop()
    assert not (tmp_path / "it_ran").exists()
