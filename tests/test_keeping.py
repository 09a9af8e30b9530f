"""The same material twice costs once: what was kept is what a run would write, and nothing else is
taken for it.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model_runtime import keeping
from model_runtime.cli import main
from model_runtime.contract import CACHE, CACHE_SECONDS, REPORT, AgeRequest
from model_runtime.errors import Cancelled, InputError
from model_runtime.images import write_exr
from model_runtime.keeping import age_or_take
from model_runtime.model_files.weights import find_model
from model_runtime.output.kept import Kept
from tests.aging import Listener, contents, write_painted_steel
from tests.meshes import write_vectors

ROOT = Path(__file__).resolve().parents[1]

pytestmark = pytest.mark.usefixtures("signals_as_before")


@pytest.fixture
def kept(tmp_path: Path) -> Kept:
    return Kept(tmp_path / "kept", 1e9)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Painted steel with all that a run may be given."""
    folder = write_painted_steel(tmp_path / "paint", 16)
    rows, columns = np.mgrid[:16, :16].astype(np.float32)
    surface = tmp_path / "surface"
    surface.mkdir()
    write_vectors(surface / "position.exr", np.stack([columns / 16, 0 * rows, -rows / 16], -1))
    write_vectors(surface / "normal.exr", np.full((16, 16, 3), (0.0, -1.0, 0.0), np.float32))
    write_exr(tmp_path / "mask.exr", (columns < 8).astype(np.float32))
    write_exr(tmp_path / "light.exr", rows / 16)
    write_exr(tmp_path / "onset.exr", columns / 16)
    shutil.copy(find_model("rust"), tmp_path / "model.safetensors")
    return folder


def asked(source: Path, output: str = "aged", **settings: Any) -> AgeRequest:
    place = source.parent
    return AgeRequest(source, "rust", place / output, frames=3, **settings)


def files_in(folder: Path) -> dict[str, bytes]:
    return {name: found for name, found in contents(folder).items() if name != REPORT}


def test_the_same_is_taken_to_the_bit_whatever_it_is_called(source: Path, kept: Kept):
    first = age_or_take(asked(source, binding="live"), Listener(), kept)
    assert CACHE_SECONDS not in first
    copy = source.with_name("other")
    copy.mkdir()
    for name in ("BaseColor", "Metallic", "Roughness"):
        shutil.copy(source / f"{name}.exr", copy / f"T_Other_{name}.exr")
    again = dataclasses.replace(
        asked(copy, "again", binding="live"), ntm=str(source.with_name("model.safetensors"))
    )
    listener = Listener()
    found = age_or_take(again, listener, kept)
    assert files_in(source.with_name("again")) == files_in(source.with_name("aged"))
    assert found == json.loads((source.with_name("again") / REPORT).read_text())
    assert 0 < found[CACHE_SECONDS] < 60
    assert str(copy) in found["command"]
    assert set(found["hashes"]["input"]) == {path.name for path in copy.iterdir()}
    # What else it says is what the run said that made it.
    changed = {name for name in found if found[name] != first.get(name)}
    assert changed == {"command", "hashes", CACHE_SECONDS}
    assert listener.warnings == found["warnings"]
    assert listener.fractions == sorted(listener.fractions)


def test_frames_and_warnings_come_back(source: Path, kept: Kept):
    request = asked(source, exposure="edges=1", sparse=True)
    first = age_or_take(request, Listener(), kept)
    listener = Listener()
    found = age_or_take(dataclasses.replace(request, output=source.with_name("b")), listener, kept)
    assert CACHE_SECONDS in found
    assert listener.warnings == first["warnings"] != []
    assert files_in(source.with_name("b")) == files_in(source.with_name("aged"))


SETTINGS = {
    "frames": 4,
    "size": 8,
    "quality": "draft",
    "tolerance": 30.0,
    "temporal_model": "constant",
    "onset": "none",
    "specular": "mono",
    "format": "torrance-sparrow",
    "binding": "live",
    "sparse": True,
    "seed": 1,
    "timing_apart": True,
    "exposure": "edges=1",
    "pattern_size": 0.1,
    "amount": 0.5,
    "starts": "0,0,0",
    "mask_means": "never",
    "grain": 0.5,
}
"""Another value of each setting that says how, not where."""


def same_as(request: AgeRequest) -> str:
    return keeping._Same.of(request).key


def test_any_setting_makes_another(source: Path):
    request = asked(source)
    fields = {field.name for field in dataclasses.fields(request)}
    assert fields == {*SETTINGS, "input", "ntm", "output", "device", "surface", "mask", "light"}
    others = [dataclasses.replace(request, **{name: value}) for name, value in SETTINGS.items()]
    assert len({same_as(each) for each in (request, *others)}) == len(SETTINGS) + 1


def test_so_does_any_content_and_its_name_does_not(source: Path):
    place = source.parent
    request = dataclasses.replace(
        asked(source, surface=place / "surface", mask=place / "mask.exr"),
        light=place / "light.exr",
        ntm=str(place / "model.safetensors"),
        onset=str(place / "onset.exr"),
    )
    keys = [same_as(request)]
    for file in (
        source / "Metallic.exr",
        place / "surface" / "normal.exr",
        place / "mask.exr",
        place / "light.exr",
        place / "onset.exr",
        place / "model.safetensors",
    ):
        other = bytearray(file.read_bytes())
        other[-1] ^= 1
        file.write_bytes(other)
        keys.append(same_as(request))
    for name in ("mask", "onset"):
        moved = place / f"moved {name}.exr"
        shutil.move(place / f"{name}.exr", moved)
        request = dataclasses.replace(request, **{name: moved if name == "mask" else str(moved)})
        keys.append(same_as(request))
    assert len(set(keys)) == len(keys) - 2
    (source / "Metallic.exr").unlink()
    assert same_as(request) not in keys


def test_another_program_makes_another(source: Path, monkeypatch: pytest.MonkeyPatch):
    before = same_as(asked(source))
    monkeypatch.setattr(keeping, "_program", lambda: {"code": "another"})
    assert same_as(asked(source)) != before


def test_what_is_damaged_is_aged_anew_and_kept_anew(source: Path, kept: Kept):
    request = asked(source, binding="live")
    age_or_take(request, Listener(), kept)
    before = files_in(request.output)
    (path,) = kept.folder.iterdir()
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 3] ^= 1
    path.write_bytes(whole)
    assert CACHE_SECONDS not in age_or_take(request, Listener(), kept)
    assert files_in(request.output) == before
    assert CACHE_SECONDS in age_or_take(request, Listener(), kept)
    assert [each.name for each in source.parent.glob(".*")] == []


def test_what_changes_while_it_is_aged_is_not_kept(source: Path, kept: Kept, monkeypatch):
    before, age = (source / "Metallic.exr").read_bytes(), keeping.age

    def aged_of_another(request: AgeRequest, reporter: Listener) -> dict[str, Any]:
        write_exr(source / "Metallic.exr", np.ones((16, 16), np.float32))
        return age(request, reporter)

    monkeypatch.setattr(keeping, "age", aged_of_another)
    age_or_take(asked(source), Listener(), kept)
    (source / "Metallic.exr").write_bytes(before)
    monkeypatch.setattr(keeping, "age", age)
    assert CACHE_SECONDS not in age_or_take(asked(source), Listener(), kept)


def test_what_fails_and_what_is_canceled_leaves_nothing(source: Path, kept: Kept):
    with pytest.raises(InputError):
        age_or_take(asked(source.with_name("absent")), Listener(), kept)
    with pytest.raises(Cancelled):
        age_or_take(asked(source), Listener(stop_at=2), kept)
    assert not kept.folder.exists() or not list(kept.folder.iterdir())
    assert not (source.with_name("aged")).exists()


def test_what_is_not_ours_in_the_output_folder_is_not_replaced(source: Path, kept: Kept):
    age_or_take(asked(source), Listener(), kept)
    (source.with_name("mine")).mkdir()
    (source.with_name("mine") / "roughness_0001.exr").write_text("mine")
    with pytest.raises(Exception, match="no run has written"):
        age_or_take(asked(source, "mine"), Listener(), kept)
    assert contents(source.with_name("mine")) == {"roughness_0001.exr": b"mine"}


def test_at_once_it_is_aged_once(source: Path, kept: Kept):
    found: list[dict[str, Any]] = []

    def make(output: str) -> None:
        found.append(age_or_take(asked(source, output), Listener(), kept))

    threads = [threading.Thread(target=make, args=(name,)) for name in "abc"]
    for each in threads:
        each.start()
    for each in threads:
        each.join(60)
    assert sorted(CACHE_SECONDS in each for each in found) == [False, True, True]


def test_the_worker_takes_what_the_command_line_has_kept(source: Path, tmp_path: Path, monkeypatch):
    """Where its option or the environment says."""
    options = ["--ntm", "rust", "--frames", "3", "--input", str(source), "--output"]
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    assert main(["age", *options, str(tmp_path / "one"), "--cache-gb", "0"]) == 0
    assert not (tmp_path / "cache").exists()
    assert main(["age", *options, str(tmp_path / "one")]) == 0
    monkeypatch.delenv(CACHE)
    args = {"input": str(source), "ntm": "rust", "frames": 3, "output": str(tmp_path / "two")}
    with subprocess.Popen(
        [sys.executable, "-m", "model_runtime", "serve", "--cache", str(tmp_path / "cache")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as worker:
        assert worker.stdin is not None and worker.stdout is not None
        worker.stdin.write(json.dumps({"id": 1, "verb": "age", "args": args}) + "\n")
        worker.stdin.flush()
        replies = map(json.loads, worker.stdout)
        done = next(reply for reply in replies if reply["type"] in ("done", "error"))
        worker.stdin.close()
    assert CACHE_SECONDS in done["result"]
    assert files_in(tmp_path / "two") == files_in(tmp_path / "one")
