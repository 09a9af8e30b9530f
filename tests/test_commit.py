"""A result is committed whole or not at all, wherever the process is killed or an operation fails.

Children commit small files and are killed with signal 9 at every operation on the file system that
Python reports (`sys.addaudithook`), one child for each.  Two ways of committing leave the old
result or the new one at once; the third, file by file, leaves what the next one puts back.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

from model_runtime.contract import REPORT, staging_places
from model_runtime.errors import OutputError
from model_runtime.output import commit, holding, staging
from model_runtime.output.commit import recover
from tests.commit_steps import COMPLETE, FAILED, HINDERED, UNEXPECTED

ROOT = Path(__file__).resolve().parents[1]
STEPS = ROOT / "tests" / "commit_steps.py"


def steps(what: str, template: Path, *places: str) -> list[tuple[Path, int]]:
    """What came of each fork (`commit_steps`): its copy of the folder, and its exit status."""
    done = subprocess.run(
        [sys.executable, "-S", str(STEPS), what, str(template), *places],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    outcomes = [(Path(folder), status) for folder, status in json.loads(done.stdout)]
    assert UNEXPECTED not in [status for _, status in outcomes], done.stderr
    return outcomes


def result(value: str, frames: int) -> dict[str, str]:
    """What a folder holds after a child has committed."""
    names = [f"kd_{k:04d}.exr" for k in range(1, frames + 1)]
    report = {"value": value, "files": {"kd": names}}
    return dict.fromkeys(names, value) | {REPORT: json.dumps(report)}


def contents(folder: Path) -> dict[str, str]:
    """Every file that is seen in `folder`, which may not be there."""
    if not folder.exists():
        return {}
    if (folder / "renders").exists():
        assert (folder / "renders" / "kd_0001.exr").read_text() == "mine"
    return {path.name: path.read_text() for path in folder.glob("[!.]*") if path.is_file()}


def leftovers(folder: Path) -> list[str]:
    beside = [path.name for path in folder.parent.iterdir() if path != folder]
    return beside + [path.name for path in folder.glob(".*")]


OLD, NEW = result("old", 4), result("new", 3)
MINE = {"notes.txt": "mine", "kd_0099.exr": "mine, too"}


def nothing(folder: Path) -> dict[str, str]:
    return {}


def empty(folder: Path) -> dict[str, str]:
    folder.mkdir()
    return {}


def earlier(folder: Path) -> dict[str, str]:
    folder.mkdir()
    for name, text in OLD.items():
        (folder / name).write_text(text)
    return OLD


def shared(folder: Path) -> dict[str, str]:
    """An earlier result among files of the user's."""
    earlier(folder)
    for name, text in MINE.items():
        (folder / name).write_text(text)
    return OLD | MINE


def deep(folder: Path) -> dict[str, str]:
    """And with a folder of the user's."""
    shared(folder)
    (folder / "renders").mkdir()
    (folder / "renders" / "kd_0001.exr").write_text("mine")
    return OLD | MINE


linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux exchanges two folders")
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs forks")
AT_ONCE = [
    pytest.param(nothing, "beside", id="new"),
    pytest.param(empty, "beside", id="empty", marks=linux),
    pytest.param(earlier, "beside", id="earlier", marks=linux),
    pytest.param(shared, "beside", id="shared", marks=linux),
]
BY_FILE = [
    pytest.param(deep, "beside", id="deep"),
    pytest.param(earlier, "within", id="within"),
    pytest.param(empty, "within", id="empty-within"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Not there yet, alone in its parent."""
    (tmp_path / "parent").mkdir()
    return tmp_path / "parent" / "aged"


@posix
@pytest.mark.parametrize(("setting", "place"), AT_ONCE)
def test_killed_at_any_step_it_leaves_the_old_result_or_the_new_one(folder, setting, place):
    before, found = setting(folder), []
    mine = {name: text for name, text in before.items() if name in MINE}
    for copy, status in steps("kill", folder.parent, place):
        assert status in (-signal.SIGKILL, COMPLETE)
        found.append(contents(copy))
        recover(copy)
        assert contents(copy) == found[-1]
        assert leftovers(copy) == []
    assert all(each in (before, NEW | mine) for each in found)
    assert (found[0], found[-1]) == (before, NEW | mine)


@posix
@pytest.mark.parametrize(("setting", "place"), BY_FILE)
def test_killed_between_two_files_the_next_one_puts_everything_back(folder, setting, place):
    before = setting(folder)
    mine = {name: text for name, text in before.items() if name in MINE}
    outcomes = steps("kill", folder.parent, place)
    mixed = [contents(copy) not in (before, NEW | mine) for copy, _ in outcomes]
    assert sum(mixed) >= len(before) - len(mine)
    for copy, status in outcomes:
        assert status in (-signal.SIGKILL, COMPLETE)
        assert contents(copy).items() >= mine.items()
        recover(copy)
        assert contents(copy) in (before, NEW | mine)
        assert leftovers(copy) == []


@posix
def test_killed_at_any_step_of_putting_back_the_next_one_goes_on(folder):
    """Of commits that were killed when all was still aside, and when all but the report was in."""
    before = deep(folder)
    copies = [copy for copy, _ in steps("kill", folder.parent, "beside")]
    mixed = [copy for copy in copies if contents(copy) not in (before, NEW | MINE)]
    for half_committed in (mixed[len(OLD) - 2], mixed[-1]):
        outcomes = steps("kill", half_committed.parent, "recover")
        assert len(outcomes) > len(OLD)
        for copy, _ in outcomes:
            recover(copy)
            assert contents(copy) == before
            assert leftovers(copy) == []


@posix
@pytest.mark.parametrize(("setting", "place"), AT_ONCE + BY_FILE)
def test_where_one_operation_fails_the_result_is_whole(folder, setting, place):
    """As with a file that is open on Windows."""
    before = setting(folder)
    mine = {name: text for name, text in before.items() if name in MINE}
    for copy, status in steps("fail", folder.parent, place):
        assert contents(copy) == (before if status == FAILED else NEW | mine)


@posix
@pytest.mark.parametrize(("setting", "place"), AT_ONCE + BY_FILE)
def test_where_the_disk_goes_away_the_next_one_puts_everything_back(folder, setting, place):
    before = setting(folder)
    mine = {name: text for name, text in before.items() if name in MINE}
    for copy, _ in steps("broken", folder.parent, place):
        recover(copy)
        assert contents(copy) in (before, NEW | mine)
        assert leftovers(copy) == []


@posix
@pytest.mark.parametrize(
    ("setting", "places"),
    [
        (nothing, ["beside"] * 4),
        (earlier, ["beside"] * 4),
        (shared, ["beside"] * 4),
        (deep, ["beside"] * 4),
        (earlier, ["beside", "within", "beside", "within"]),
    ],
    ids=["new", "earlier", "shared", "deep", "both ways"],
)
def test_runs_that_finish_together_do_not_mix(folder, setting, places):
    mine = {name: text for name, text in setting(folder).items() if name in MINE}
    wholes = [result(f"v{k}", 20 + k) | mine for k in range(len(places))]
    for _ in range(10):
        (copy, *_), statuses = zip(*steps("together", folder.parent, *places), strict=True)
        assert set(statuses) == {HINDERED}
        assert contents(copy) in wholes
        assert leftovers(copy) == []
        shutil.rmtree(copy.parent)


def stage_and_commit(folder: Path, names: list[str]) -> None:
    with staging.staging(folder) as staged:
        for name in names:
            (staged / name).write_text("new")
        (staged / REPORT).write_text(json.dumps({"files": {"kd": names}}))
        commit.commit(staged, folder, names)


@linux
def test_what_the_user_saves_in_between_stays(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """While the folders change places: over what was there, beside it, and in place."""
    exchange = commit._exchange

    def save_and_exchange(*folders: Path) -> None:
        (folder / "saved.tmp").write_text("saved")
        (folder / "saved.tmp").replace(folder / "notes.txt")
        (folder / "render.png").write_text("rendered")
        (folder / "kd_0099.exr").write_text("painted")
        exchange(*folders)

    monkeypatch.setattr(commit, "_exchange", save_and_exchange)
    shared(folder)
    names = ["kd_0001.exr"]
    stage_and_commit(folder, names)
    saved = {"notes.txt": "saved", "render.png": "rendered", "kd_0099.exr": "painted"}
    assert contents(folder).items() >= saved.items()
    assert sorted(contents(folder)) == sorted([*saved, *names, REPORT])
    assert leftovers(folder) == []


class TestHeld:
    def test_nobody_waits_for_ever(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        earlier(folder)
        monkeypatch.setattr(holding, "_PATIENCE", 0.1)
        held = holding.hold(folder)
        with pytest.raises(OutputError, match="Another run has been writing"):
            stage_and_commit(folder, ["kd_0001.exr"])
        holding.let_go(folder, held)
        assert contents(folder) == OLD

    @posix
    def test_a_dead_owner_holds_nothing(self, folder: Path):
        folder.mkdir()
        code = (
            "import sys, time\nfrom pathlib import Path\n"
            "from model_runtime.output.holding import hold\n"
            "hold(Path(sys.argv[1]))\nprint('held', flush=True)\ntime.sleep(60)"
        )
        owner = subprocess.Popen(
            [sys.executable, "-S", "-c", code, str(folder)], cwd=ROOT, stdout=subprocess.PIPE
        )
        assert owner.stdout is not None
        assert owner.stdout.readline() == b"held\n"
        with pytest.raises(BlockingIOError):
            holding.hold(folder)
        owner.kill()
        owner.communicate()
        holding.let_go(folder, holding.hold(folder))

    def test_a_file_system_without_locks_is_taken_as_it_is(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ):
        def refuse(_: Path) -> int:
            raise OSError(errno.ENOLCK, "No locks available")

        earlier(folder)
        living = staging_places(folder, "living__")[0]
        living.mkdir()
        for module in (commit, holding, staging):
            monkeypatch.setattr(module, "hold", refuse)
        stage_and_commit(folder, ["kd_0001.exr"])
        assert contents(folder)["kd_0001.exr"] == "new"
        assert leftovers(folder) == [living.name]  # whether its owner lives cannot be told

    def test_a_system_that_locks_files_only(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        """As Windows: the same promises with a file in the folder, which goes again."""
        fcntl = pytest.importorskip("fcntl")
        windows = types.ModuleType("msvcrt")
        windows.LK_NBLCK = fcntl.LOCK_EX | fcntl.LOCK_NB
        windows.locking = lambda descriptor, how, _: fcntl.flock(descriptor, how)
        monkeypatch.setitem(sys.modules, "msvcrt", windows)
        for module in (commit, holding):
            monkeypatch.setattr(module, "sys", types.SimpleNamespace(platform="win32"))
        earlier(folder)
        living, dead = (staging_places(folder, token)[0] for token in ("living__", "dead____"))
        living.mkdir()
        dead.mkdir()
        (dead / ".aged.lock").touch()
        held = holding.hold(living)
        with pytest.raises(BlockingIOError):
            holding.hold(living)
        names = ["kd_0001.exr", "kd_0002.exr"]
        stage_and_commit(folder, names)
        assert sorted(contents(folder)) == [REPORT, *names]
        assert leftovers(folder) == [living.name]
        holding.let_go(living, held)
        assert list(living.iterdir()) == []


def test_a_clock_that_is_wrong_sweeps_no_living_run(folder: Path):
    """A staging folder is as old as its owner, whatever its date says."""
    living = staging_places(folder, "living__")[0]
    living.mkdir()
    held = holding.hold(living)
    yesterday = time.time() - 30 * 24 * 3600
    os.utime(living, (yesterday, yesterday))
    recover(folder)
    assert living.is_dir()
    holding.let_go(living, held)
    recover(folder)
    assert not living.exists()


@posix
def test_what_is_swept_is_held_until_it_is_gone(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """Or a run that has just made its staging folder could take hold of it, and lose it."""
    left, _ = staging_places(folder, "0" * 8)
    left.mkdir(parents=True)
    remove, swept = shutil.rmtree, []

    def remove_held(path: Path, **options: bool) -> None:
        with pytest.raises(BlockingIOError):
            holding.hold(path)
        swept.append(path)
        remove(path, **options)

    monkeypatch.setattr(commit.shutil, "rmtree", remove_held)
    recover(folder)
    assert swept == [left]
    assert not left.exists()
