"""Results appear whole or not at all, and take nothing of the user's with them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from model_runtime.contract import REPORT
from model_runtime.errors import OutputError
from model_runtime.images import read_image
from model_runtime.output.stored import StagedResult
from tests.staged_results import GRAY, contents, leftovers, names, write


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Not there yet, and with characters that paths may have."""
    return tmp_path / "inner" / "aged [ü] 1*"


def test_a_result_is_its_files_and_a_report(folder: Path):
    write(folder, 3)
    assert sorted(contents(folder)) == sorted([*names(3), REPORT])
    report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    assert report == {"frames": 3, "files": {"alpha": names(3)}}
    assert (read_image(folder / names(3)[2], color=False) == 0.5).all()
    assert leftovers(folder) == []


def test_nothing_appears_before_it_is_complete(folder: Path):
    with StagedResult(folder) as staged:
        for name in names(20):
            staged.write(name, GRAY)
        staged.finish()
        assert not folder.exists()
        staged.commit({"files": {"alpha": names(20)}})
        assert len(contents(folder)) == 21


def test_a_relative_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write(Path("aged"), 1)
    assert (tmp_path / "aged" / REPORT).exists()


def test_a_failure_leaves_the_earlier_result(folder: Path):
    write(folder, 3)
    before = contents(folder)

    def fail() -> None:
        with StagedResult(folder) as staged:
            for name in names(5):
                staged.write(name, GRAY * 0)
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        fail()
    assert contents(folder) == before
    assert leftovers(folder) == []


def test_leaving_without_commit_leaves_the_earlier_result(folder: Path):
    write(folder, 3)
    before = contents(folder)
    with StagedResult(folder) as staged:
        staged.write("alpha_0001.exr", GRAY * 0)
    assert contents(folder) == before
    assert leftovers(folder) == []


def test_a_shorter_result_leaves_no_frames_of_the_longer_one(folder: Path):
    write(folder, 5)
    write(folder, 2, value=0.25)
    assert sorted(contents(folder)) == sorted([*names(2), REPORT])
    assert (read_image(folder / names(2)[0], color=False) == 0.25).all()


def test_frames_of_a_sparse_result_go_too(folder: Path):
    with StagedResult(folder) as staged:
        for name in names(3):
            staged.write(name, GRAY)
        mixes = [[[name, 1.0]] for name in names(3)]
        staged.commit({"files": {"alpha": mixes}})
    write(folder, 1)
    assert sorted(contents(folder)) == sorted([*names(1), REPORT])


def test_the_user_s_own_files_stay(folder: Path):
    write(folder, 5)
    (folder / "notes.txt").write_text("mine")
    (folder / "photo.exr").write_bytes(b"mine")
    (folder / "alpha_0099.exr").write_bytes(b"mine too, no report lists it")
    (folder / "renders").mkdir()
    (folder / "renders" / "alpha_0001.exr").write_bytes(b"mine")
    write(folder, 2)
    kept = {"notes.txt", "photo.exr", "alpha_0099.exr"}
    assert set(contents(folder)) == kept | {*names(2), REPORT}
    assert (folder / "renders" / "alpha_0001.exr").read_bytes() == b"mine"


HOSTILE_NAMES = [
    "../outside_0001.exr",
    "/outside_0001.exr",
    "sub/inside_0001.exr",
    "..",
    ".",
    "",
    "notes.txt",
    "photo.exr",
    "nul\0_0001.exr",
    "\ud800_0001.exr",
    "sub",
    "folder_0001.exr",
    5,
    None,
    ["alpha_0002.exr"],
    {"alpha": 1},
]


@pytest.mark.parametrize("name", HOSTILE_NAMES, ids=ascii)
@pytest.mark.parametrize("sparse", [False, True], ids=["whole", "sparse"])
def test_a_hostile_report_removes_nothing_of_the_user_s(folder: Path, name: Any, sparse: bool):
    folder.mkdir(parents=True)
    mine = [
        folder.parent / "outside_0001.exr",
        folder / "sub" / "inside_0001.exr",
        folder / "folder_0001.exr" / "inside.txt",
        folder / "notes.txt",
        folder / "photo.exr",
    ]
    for path in mine:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"mine")
    entry = [[name, 1.0]] if sparse else name
    (folder / REPORT).write_text(json.dumps({"files": {"alpha": [entry]}}))
    write(folder, 2)
    for path in mine:
        assert path.read_bytes() == b"mine"
    assert json.loads((folder / REPORT).read_text())["frames"] == 2


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        "null",
        '{"files": 3}',
        '{"age": 36, "name": "of somebody else"}',
        '{"files": [["alpha_0001.exr"]]}',
        "[" * 100_000,
        '{"files": ' * 50_000 + "1" + "}" * 50_000,
        "\xff\xfe",
    ],
    ids=lambda text: text[:24],
)
def test_a_report_that_is_not_ours_is_refused(folder: Path, text: str):
    folder.mkdir(parents=True)
    (folder / REPORT).write_bytes(text.encode("latin-1"))
    with pytest.raises(OutputError, match=r"aged\.json, which no run has written"):
        write(folder, 1)
    assert contents(folder) == {REPORT: text.encode("latin-1")}
    assert leftovers(folder) == []


@pytest.mark.parametrize("text", ['{"files": {"a": 3}}', '{"files": {"a": [[], null, {"b": 1}]}}'])
def test_a_report_of_ours_may_be_odd(folder: Path, text: str):
    folder.mkdir(parents=True)
    (folder / REPORT).write_text(text)
    write(folder, 1)
    assert sorted(contents(folder)) == [REPORT, names(1)[0]]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
def test_a_report_that_never_ends_is_not_read(folder: Path):
    folder.mkdir(parents=True)
    os.mkfifo(folder / REPORT)
    with pytest.raises(OutputError, match=r"aged\.json"):
        write(folder, 1)


@pytest.mark.parametrize("reported", [False, True], ids=["no result", "result of ours"])
def test_files_that_no_report_lists_are_refused(folder: Path, reported: bool):
    """They are named like ours, but no run has written them."""
    folder.mkdir(parents=True)
    if reported:
        write(folder, 2)
    (folder / "alpha_0003.exr").write_bytes(b"mine")
    before = contents(folder)
    write(folder.with_name("other"), 4)
    with pytest.raises(OutputError, match=r"alpha_0003\.exr, which no run") as error:
        write(folder, 4)
    assert "choose another output folder" in error.value.hint
    assert contents(folder) == before
    with StagedResult(folder) as staged:
        with pytest.raises(OutputError, match=r"alpha_0003\.exr"):
            staged.require_free(names(3))
        staged.require_free(names(2))
    write(folder, 2)
    assert (folder / "alpha_0003.exr").read_bytes() == b"mine"


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
def test_links_in_the_folder_are_not_followed(folder: Path, tmp_path: Path):
    target = tmp_path / "precious.exr"
    target.write_bytes(b"mine")
    folder.mkdir(parents=True)
    (folder / "alpha_0001.exr").symlink_to(target)  # replaced
    (folder / "alpha_0002.exr").symlink_to(target)  # removed
    (folder / REPORT).write_text(json.dumps({"files": {"alpha": names(2)}}))
    write(folder, 1)
    assert target.read_bytes() == b"mine"
    assert sorted(contents(folder)) == [REPORT, names(1)[0]]


@pytest.mark.parametrize("blocked", ["alpha_0002.exr", REPORT])
def test_a_folder_in_the_way_of_a_file_is_found_before_anything_is_replaced(
    folder: Path, blocked: str
):
    write(folder, 3)
    (folder / blocked).unlink()
    (folder / blocked).mkdir()
    before = contents(folder)
    with pytest.raises(OutputError) as error:
        write(folder, 3, value=0.0)
    assert blocked in error.value.message
    assert contents(folder) == before
    assert leftovers(folder) == []


class TestAbandoned:
    """What a worker that was killed has left behind."""

    def abandon(self, folder: Path) -> Path:
        path = folder.parent / f".{folder.name}.partial-abcd_012"
        path.mkdir(parents=True)
        (path / "alpha_0001.exr").write_bytes(b"half")
        return path

    def test_is_swept(self, folder: Path):
        dead = self.abandon(folder)
        write(folder, 1)
        assert not dead.exists()

    def test_unless_its_owner_lives(self, folder: Path):
        with StagedResult(folder) as staged:
            staged.write("alpha_0001.exr", GRAY)
            write(folder, 2)
            staged.commit({"files": {"alpha": names(1)}})
        assert sorted(contents(folder)) == [REPORT, *names(1)]

    def test_another_result_s_is_left_alone(self, tmp_path: Path):
        others = [self.abandon(tmp_path / name) for name in ("a", "[ab].partial-x")]
        write(tmp_path / "[ab]", 1)
        assert all(other.exists() for other in others)
