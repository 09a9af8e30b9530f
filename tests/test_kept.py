"""What is kept of results: whole or not at all, within its bound, whoever else is at it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

import pytest

from model_runtime.contract import REPORT, frame_file
from model_runtime.errors import Cancelled
from model_runtime.output import kept as store
from model_runtime.output.kept import Kept

ROOT = Path(__file__).resolve().parents[1]
KEYS = [f"{number:064x}" for number in range(8)]
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals")


def result(folder: Path, size: int = 1000, value: str = "a") -> dict:
    """A result of one file of this size in `folder`; its report."""
    folder.mkdir(parents=True, exist_ok=True)
    report = {"files": {"kd": [frame_file("kd", 0)]}, "value": value}
    (folder / frame_file("kd", 0)).write_bytes(value.encode() * size)
    (folder / REPORT).write_text(json.dumps(report))
    return report


@pytest.fixture
def kept(tmp_path: Path) -> Kept:
    return Kept(tmp_path / "kept", 1e6)


def taken(kept: Kept, key: str) -> dict[str, bytes] | None:
    found: dict[str, bytes] = {}
    report = kept.take(key, found.__setitem__)
    return None if report is None else found


def test_what_was_kept_is_taken(kept: Kept, tmp_path: Path):
    report = result(tmp_path / "aged")
    assert not kept.has(KEYS[0]) and taken(kept, KEYS[0]) is None
    kept.keep(KEYS[0], tmp_path / "aged", report)
    assert kept.has(KEYS[0])
    assert taken(kept, KEYS[0]) == {frame_file("kd", 0): b"a" * 1000}
    assert kept.take(KEYS[0], lambda name, content: None) == report
    assert 1000 < kept.size() < 2000
    kept.clear()
    assert kept.size() == 0 and not list(kept.folder.iterdir())


def test_a_folder_that_another_run_has_written_to_meanwhile_is_not_kept(kept: Kept, tmp_path: Path):
    report = result(tmp_path / "aged")
    result(tmp_path / "aged", value="b")
    kept.keep(KEYS[0], tmp_path / "aged", report)
    assert not kept.has(KEYS[0])


def test_what_was_not_used_for_longest_goes_first(tmp_path: Path):
    kept = Kept(tmp_path / "kept", 5000)
    for number, key in enumerate(KEYS[:4]):
        kept.keep(key, tmp_path / "aged", result(tmp_path / "aged", 900))
        os.utime(kept.folder / f"{key}.zip", (number, number))
    assert taken(kept, KEYS[0]) is not None
    kept.keep(KEYS[4], tmp_path / "aged", result(tmp_path / "aged", 900))
    assert [kept.has(key) for key in KEYS[:5]] == [True, False, True, True, True]
    assert kept.size() <= 5000


def test_what_would_take_most_of_it_is_not_kept(kept: Kept, tmp_path: Path, monkeypatch):
    kept.keep(KEYS[0], tmp_path / "aged", result(tmp_path / "aged", 250_001))
    assert not kept.has(KEYS[0])
    report = result(tmp_path / "aged", 1000)
    usage = type("Usage", (), {"free": 500_000})
    monkeypatch.setattr(store.shutil, "disk_usage", lambda folder: usage)
    kept.keep(KEYS[0], tmp_path / "aged", report)
    assert not kept.has(KEYS[0]), "the disk would be filled"


def archive(path: Path, files: dict[str, bytes], **how) -> None:
    with zipfile.ZipFile(path, "w", **how) as written:
        for name, content in files.items():
            written.writestr(name, content)


REPORTED = json.dumps({"files": {"kd": [frame_file("kd", 0)]}}).encode()
WHOLE = {frame_file("kd", 0): b"x" * 1000, REPORT: REPORTED}
OTHERS = {
    "a file more": WHOLE | {"../evil": b""},
    "a file less": {REPORT: REPORTED},
    "no report": {frame_file("kd", 0): b""},
    "another name": {"mine.exr": b"", REPORT: b'{"files": {"kd": ["mine.exr"]}}'},
    "no JSON": WHOLE | {REPORT: b"{"},
    "no object": WHOLE | {REPORT: b"[]"},
    "no files": WHOLE | {REPORT: b'{"files": 3}'},
    "deep": WHOLE | {REPORT: b"[" * 100_000},
}


@pytest.mark.parametrize("what", OTHERS)
def test_what_is_no_archive_of_ours_is_dropped(kept: Kept, what: str):
    kept.folder.mkdir()
    archive(kept.folder / f"{KEYS[0]}.zip", OTHERS[what])
    assert taken(kept, KEYS[0]) is None
    assert not kept.has(KEYS[0])


def test_what_would_not_stop_unpacking_is_dropped(kept: Kept):
    kept.folder.mkdir()
    bomb = WHOLE | {frame_file("kd", 0): bytes(1 << 24)}
    archive(kept.folder / f"{KEYS[0]}.zip", bomb, compression=zipfile.ZIP_DEFLATED)
    assert taken(kept, KEYS[0]) is None and not kept.has(KEYS[0])


def test_damage_anywhere_is_told(kept: Kept, tmp_path: Path):
    report = result(tmp_path / "aged", 300)
    kept.keep(KEYS[0], tmp_path / "aged", report)
    path = kept.folder / f"{KEYS[0]}.zip"
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        for damaged in (
            whole[:place],
            whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :],
        ):
            path.write_bytes(damaged)
            found = taken(kept, KEYS[0])
            # Dates and the like are nobody's business.
            assert found in (None, {frame_file("kd", 0): b"a" * 300})
            assert (found is None) != kept.has(KEYS[0])


def test_nothing_but_what_is_ours_is_removed(kept: Kept, tmp_path: Path):
    result(kept.folder / "mine")
    (kept.folder / "mine.zip").write_text("mine")
    kept.keep(KEYS[0], tmp_path / "aged", result(tmp_path / "aged"))
    kept.clear()
    assert {path.name for path in kept.folder.iterdir()} == {"mine", "mine.zip"}


def test_a_place_that_cannot_be_written_to_is_done_without(tmp_path: Path):
    (tmp_path / "file").write_text("")
    kept = Kept(tmp_path / "file", 1e6)
    with kept.alone(KEYS[0], lambda: pytest.fail("nobody else is there")):
        kept.keep(KEYS[0], tmp_path / "aged", result(tmp_path / "aged"))
    assert taken(kept, KEYS[0]) is None and kept.size() == 0
    kept.clear()


def test_of_several_one_makes_it_and_the_others_wait(kept: Kept):
    inside, made = [], []

    def make() -> None:
        with kept.alone(KEYS[0], lambda: None):
            inside.append(1)
            assert len(inside) == 1
            time.sleep(0.05)
            inside.pop()
            made.append(1)

    threads = [threading.Thread(target=make) for _ in range(3)]
    for each in threads:
        each.start()
    for each in threads:
        each.join(10)
    assert len(made) == 3 and not list(kept.folder.iterdir())


def test_who_waits_may_be_told_to_stop(kept: Kept):
    def stop() -> None:
        raise Cancelled

    with (
        kept.alone(KEYS[0], stop),
        pytest.raises(Cancelled),
        Kept(kept.folder, 1).alone(KEYS[0], stop),
    ):
        pytest.fail("it was let in")


_KILLED = """
import os, signal, sys
from pathlib import Path
from model_runtime.output.kept import Kept
from tests.test_kept import KEYS, result
kept, aged = Kept(Path(sys.argv[1]) / "kept", 1e6), Path(sys.argv[1]) / "aged"
report, left = result(aged), int(sys.argv[2])
def count(event, arguments):
    global left
    if event in ("open", "os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.utime"):
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(count)
with kept.alone(KEYS[0], lambda: None):
    kept.keep(KEYS[0], aged, report)
print("done")
"""


@posix
def test_killed_anywhere_it_has_kept_all_or_nothing_and_the_next_one_tidies_up(tmp_path: Path):
    aged, found = result(tmp_path / "aged"), []
    for step in range(40):
        kept = Kept(tmp_path / str(step) / "kept", 1e6)
        run = subprocess.run(
            [sys.executable, "-c", _KILLED, str(kept.folder.parent), str(step)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode in (0, -signal.SIGKILL), run.stderr
        found.append(taken(kept, KEYS[0]))
        if kept.folder.exists():
            for left in kept.folder.glob(".*"):
                os.utime(left, (0, 0))
        with kept.alone(KEYS[0], lambda: pytest.fail("nobody lives who holds it")):
            kept.keep(KEYS[0], tmp_path / "aged", aged)
        assert [path.name for path in kept.folder.iterdir()] == [f"{KEYS[0]}.zip"]
        if run.returncode == 0:
            break
    assert run.returncode == 0
    assert found[0] is None and found[-1] is not None
    assert all(each in (None, {frame_file("kd", 0): b"a" * 1000}) for each in found)
