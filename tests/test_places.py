"""Folders that a result may go to, whatever lies around them; and what is said of those it cannot.

Where that takes a file system of its own, or a file that cannot be moved, root has to make it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from model_runtime.contract import REPORT
from model_runtime.errors import OutputError
from model_runtime.output import stored
from model_runtime.output.stored import StagedResult, check_space
from tests.staged_results import GRAY, contents, leftovers, names, write


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Not there yet, and with characters that paths may have."""
    return tmp_path / "inner" / "aged [ü] 1*"


def needs(command: list[str]) -> None:
    """Run `command`, or skip the test where this user or system cannot."""
    if not shutil.which(command[0]) or subprocess.run(command, capture_output=True).returncode:
        pytest.skip(f"`{' '.join(command[:2])}` cannot be done here")


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Callable[..., Path]]:
    """Mounts what the words for `mount` say on a new folder."""
    with ExitStack() as leaving:

        def mount(name: str, *words: str) -> Path:
            place = tmp_path / name
            place.mkdir()
            needs(["mount", *words, str(place)])
            leaving.callback(subprocess.run, ["umount", str(place)], check=True)
            return place

        yield mount


@pytest.fixture
def locked() -> Iterator[Callable[[Path], None]]:
    """Makes a file or folder immutable, even to root."""
    with ExitStack() as leaving:

        def lock(path: Path) -> None:
            needs(["chattr", "+i", str(path)])
            leaving.callback(subprocess.run, ["chattr", "-i", str(path)], check=True)

        yield lock


def replace_twice(folder: Path) -> None:
    """Write a result, one over it, and one beside a file of the user's."""
    write(folder, 3)
    write(folder, 2, value=0.25)
    assert sorted(contents(folder)) == sorted([*names(2), REPORT])
    (folder / "notes.txt").write_text("mine")
    write(folder, 1)
    assert sorted(contents(folder)) == sorted([*names(1), REPORT, "notes.txt"])
    assert not list(folder.glob(".*"))


class TestWorks:
    def test_a_disk_of_its_own(self, mounted):
        folder = mounted("disk", "-t", "tmpfs", "tmpfs")
        replace_twice(folder)
        assert leftovers(folder) == []

    def test_another_part_of_the_same_disk(self, mounted, tmp_path: Path):
        """It has the same device number, and still nothing can be moved across."""
        (tmp_path / "part").mkdir()
        replace_twice(mounted("bound", "--bind", str(tmp_path / "part")))

    def test_a_link_to_another_disk(self, mounted, tmp_path: Path):
        disk = mounted("disk", "-t", "tmpfs", "tmpfs")
        (tmp_path / "aged").symlink_to(disk)
        replace_twice(tmp_path / "aged")
        assert (tmp_path / "aged").is_symlink()
        shutil.rmtree(disk / "inner", ignore_errors=True)
        (disk / "inner").mkdir()
        (tmp_path / "deep").symlink_to(disk / "inner")
        replace_twice(tmp_path / "deep")

    def test_a_folder_in_one_that_cannot_be_written_to(self, locked, tmp_path: Path):
        folder = tmp_path / "locked" / "aged"
        folder.mkdir(parents=True)
        locked(folder.parent)
        replace_twice(folder)

    def test_the_folder_one_is_in(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        """A shell goes on in it."""
        (tmp_path / "aged").mkdir()
        monkeypatch.chdir(tmp_path / "aged")
        write(Path(), 2)
        write(Path(), 3)
        assert Path.cwd() == tmp_path / "aged"
        assert sorted(path.name for path in Path().iterdir()) == sorted([*names(3), REPORT])

    @pytest.mark.parametrize("there", [False, True], ids=["new", "there"])
    @pytest.mark.parametrize("length", [230, 255])
    def test_the_longest_names(self, tmp_path: Path, length: int, there: bool):
        folder = tmp_path / ("x" * length)
        if there:
            folder.mkdir()
        replace_twice(folder)
        assert leftovers(folder) == []

    @pytest.mark.skipif(os.name == "nt", reason="file names are text on Windows")
    @pytest.mark.parametrize("name", [b"caf\xe9", b"\xff\xfe *[?]"])
    def test_a_name_that_is_no_text(self, tmp_path: Path, name: bytes):
        try:
            (tmp_path / os.fsdecode(name)).mkdir()
        except OSError:
            pytest.skip("this file system takes UTF-8 only")
        replace_twice(tmp_path / os.fsdecode(name))

    @pytest.mark.skipif(os.name == "nt", reason="Windows has other permissions")
    def test_permissions_of_the_folder_stay(self, tmp_path: Path):
        folder = tmp_path / "aged"
        write(folder, 1)
        folder.chmod(0o2770)
        write(folder, 2)
        assert folder.stat().st_mode & 0o7777 == 0o2770


class TestIsSaid:
    """On entry: before anything is computed."""

    def refused(self, folder: Path) -> str:
        with pytest.raises(OutputError) as error, StagedResult(folder):
            pytest.fail("it was taken")
        assert error.value.hint
        return error.value.message

    def test_a_name_that_is_too_long(self, tmp_path: Path):
        assert "too long" in self.refused(tmp_path / ("x" * 256))
        assert "too long" in self.refused(tmp_path / ("x" * 300) / "aged")
        assert "too long" in self.refused(tmp_path.joinpath(*["x" * 200] * 25))
        assert list(tmp_path.iterdir()) == []

    def test_a_name_that_no_system_takes(self, tmp_path: Path):
        assert "null" in self.refused(tmp_path / "a\0b")

    @pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
    def test_links_in_a_circle(self, tmp_path: Path):
        (tmp_path / "a").symlink_to(tmp_path / "b")
        (tmp_path / "b").symlink_to(tmp_path / "a")
        assert "cannot be written" in self.refused(tmp_path / "a" / "aged")

    def test_a_folder_that_cannot_be_written_to(self, locked, tmp_path: Path):
        """Though it might be replaced as a whole."""
        folder = tmp_path / "aged"
        write(folder, 2)
        before = contents(folder)
        locked(folder)
        assert "Operation not permitted" in self.refused(folder)
        assert contents(folder) == before
        assert leftovers(folder) == []

    def test_a_disk_that_can_only_be_read(self, mounted):
        folder = mounted("disk", "-t", "tmpfs", "-o", "ro", "tmpfs")
        assert "Read-only" in self.refused(folder)
        assert "Read-only" in self.refused(folder / "aged")

    def test_a_disk_without_room_for_files(self, mounted):
        disk = mounted("disk", "-t", "tmpfs", "-o", "nr_inodes=20", "tmpfs")
        check_space(disk / "aged", 1000, files=10)
        with pytest.raises(OutputError, match=r"may have 36 files; .* has room for 1\d\."):
            check_space(disk / "aged", 1000, files=36)
        for k in range(19):
            (disk / str(k)).touch()
        assert "No space left" in self.refused(disk / "aged")


def test_a_file_that_cannot_be_moved_leaves_the_earlier_result(locked, tmp_path: Path):
    folder = tmp_path / "aged"
    write(folder, 3)
    before = contents(folder)
    locked(folder / names(3)[1])
    for mine in (None, "notes.txt"):
        if mine:
            (folder / mine).write_text("mine")
            before[mine] = b"mine"
        with pytest.raises(OutputError, match=r"alpha_0002\.exr: Operation not permitted"):
            write(folder, 3, value=0.25)
        assert contents(folder) == before
        assert leftovers(folder) == []


@pytest.mark.parametrize("harm", ["delete", "truncate", "all"])
def test_staged_files_that_others_change_are_noticed(tmp_path: Path, harm: str):
    folder = tmp_path / "aged"
    write(folder, 1)
    before = contents(folder)

    def change() -> None:
        with StagedResult(folder) as staged:
            for name in names(3):
                staged.write(name, GRAY)
            staged.finish()
            (staging,) = (path for path in tmp_path.iterdir() if path != folder)
            if harm == "delete":
                (staging / names(3)[1]).unlink()
            elif harm == "truncate":
                os.truncate(staging / names(3)[1], 100)
            else:
                shutil.rmtree(staging)
            staged.commit({"files": {"alpha": names(3)}})

    with pytest.raises(OutputError, match="another program has changed it"):
        change()
    assert contents(folder) == before
    assert leftovers(folder) == []


def test_folders_made_for_a_result_that_does_not_come_go_again(tmp_path: Path):
    with StagedResult(tmp_path / "a" / "b" / "aged") as staged:
        staged.write(names(1)[0], GRAY)
    assert list(tmp_path.iterdir()) == []


class TestWhatCannotBeWritten:
    def test_a_file_where_the_folder_should_be(self, tmp_path: Path):
        (tmp_path / "aged").write_text("mine")
        with (
            pytest.raises(OutputError, match="is a file, not a folder"),
            StagedResult(tmp_path / "aged"),
        ):
            pass
        assert (tmp_path / "aged").read_text() == "mine"

    def test_a_file_where_its_parent_should_be(self, tmp_path: Path):
        (tmp_path / "inner").write_text("mine")
        with pytest.raises(OutputError, match="cannot be written"):
            write(tmp_path / "inner" / "aged", 1)

    @pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
    def test_a_link_that_leads_nowhere(self, tmp_path: Path):
        (tmp_path / "aged").symlink_to(tmp_path / "none" / "none")
        with pytest.raises(OutputError):
            write(tmp_path / "aged", 1)
        assert leftovers(tmp_path / "aged") == []

    def test_a_folder_without_permission(self, tmp_path: Path):
        (tmp_path / "inner").mkdir(mode=0o500)
        if os.access(tmp_path / "inner", os.W_OK):
            pytest.skip("permissions do not bind this user (root)")
        with pytest.raises(OutputError, match="cannot be written"):
            write(tmp_path / "inner" / "aged", 1)

    def test_a_read_only_file_system(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        write(folder, 2)
        before = contents(folder)

        def refuse(*_: object, **__: object) -> None:
            raise OSError(30, "Read-only file system")

        monkeypatch.setattr(Path, "mkdir", refuse)
        with pytest.raises(OutputError, match="Read-only file system"):
            write(folder, 1)
        assert contents(folder) == before

    def test_an_image_that_cannot_be_written(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        """Whichever of the queued ones it is, the run ends with its error."""
        write(folder, 2)
        before = contents(folder)

        def refuse(path: Path, pixels: object, **_: object) -> None:
            raise OutputError(
                f"{path.name} cannot be written: No space left on device.", "Free it."
            )

        monkeypatch.setattr(stored, "write_exr", refuse)
        with pytest.raises(OutputError, match="No space left"):
            write(folder, 30)
        assert contents(folder) == before
        assert leftovers(folder) == []


class TestSpace:
    def test_too_little_is_said_before_anything_is_done(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ):
        monkeypatch.setattr(
            stored.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 5_000_000)
        )
        check_space(folder, 5_000_000)
        with pytest.raises(OutputError, match=r"may need 6 MB; .* has 5 left") as error:
            check_space(folder, 6_000_000)
        assert "smaller size" in error.value.hint
        assert not folder.exists()

    def test_the_disk_asked_is_that_of_the_nearest_folder_there_is(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ):
        asked = []

        def usage(path: Path):
            asked.append(path)
            return shutil._ntuple_diskusage(1, 0, 1)

        monkeypatch.setattr(stored.shutil, "disk_usage", usage)
        check_space(tmp_path / "a" / "b" / "c", 1)
        check_space(tmp_path, 1)
        monkeypatch.chdir(tmp_path)
        check_space(Path("aged"), 1)
        assert [Path(path).resolve() for path in asked] == [tmp_path.resolve()] * 3

    @pytest.fixture
    def small_disk(self, tmp_path: Path) -> Iterator[Path]:
        """A file system of 256 kB."""
        disk = tmp_path / "disk"
        disk.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
        if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
            pytest.skip("no file system can be mounted here")
        yield disk
        subprocess.run(["umount", str(disk)], check=True)

    def test_a_disk_that_is_full_in_the_middle(self, small_disk: Path):
        write(small_disk / "aged", 3)
        before = contents(small_disk / "aged")
        noise = np.random.default_rng(0).random((128, 128, 3), np.float32)

        def fill() -> None:
            with StagedResult(small_disk / "aged") as staged:
                for name in names(12):
                    staged.write(name, noise)
                staged.commit({"files": {"alpha": names(12)}})

        with pytest.raises(OutputError, match="No space left"):
            fill()
        assert contents(small_disk / "aged") == before
        assert leftovers(small_disk / "aged") == []
