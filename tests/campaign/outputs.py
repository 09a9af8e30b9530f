"""Output folders that hold something, lie elsewhere, are full, or cannot be written."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

from .evidence import Evidence
from .samples import exr
from .trial import Trial

__all__ = ("attempt_output",)


def attempt_output(trial: Trial) -> list[Evidence]:
    """One output folder out of the ordinary, with or without an earlier result."""
    trial.textures()
    place = trial.rng.choice(_PLACES + _DISKS)
    if place in _DISKS and not _may_mount():
        place = _replaces_another
    return [place(trial)]


def _names(trial: Trial) -> list[str]:
    maps = ("base_color", "metallic", "specular", "roughness", "kd", "ks", "alpha")
    return [f"{name}_{k:04d}.exr" for name in maps for k in (1, 2, 3)]


def _holds_files_of_the_user(trial: Trial) -> Evidence:
    rng = trial.rng
    if rng.random() < 0.4:
        trial.put_earlier_result()
    trial.output.mkdir(exist_ok=True)
    for name in (*rng.sample(_names(trial), rng.choice((1, 4))), "notes.txt"):
        if not (trial.output / name).exists():
            exr(trial.output / name, Y=np.full((2, 2), 0.25))
    return trial.age(trial.request(sparse=rng.random() < 0.3))


def _holds_folders(trial: Trial) -> Evidence:
    trial.put_earlier_result()
    name = trial.rng.choice((*_names(trial), "aged.json", "textures"))
    path = trial.output / name
    path.unlink(missing_ok=True)
    path.mkdir()
    (path / "kept.txt").write_text("kept")
    return trial.age(trial.request())


def _holds_links(trial: Trial) -> Evidence:
    """Files of an earlier result replaced by links, which must not be written through."""
    trial.put_earlier_result()
    elsewhere = trial.folder / "elsewhere"
    elsewhere.write_bytes(b"kept")
    path = trial.output / trial.rng.choice((*_names(trial)[:12], "aged.json"))
    path.unlink(missing_ok=True)
    path.symlink_to(trial.rng.choice((elsewhere, "absent", path)))
    return trial.age(trial.request())


def _holds_a_damaged_report(trial: Trial) -> Evidence:
    trial.put_earlier_result()
    odd = (b"", b"{}", b"[" * 100_000, b'{"files": {"x": ["../in/M_Color.png", 3, null]}}', b"\xff")
    (trial.output / "aged.json").write_bytes(trial.rng.choice(odd))
    return trial.age(trial.request())


def _replaces_another(trial: Trial) -> Evidence:
    """An earlier result with more frames, and of other maps."""
    trial.put_earlier_result()
    frames, wanted = trial.rng.choice((1, 2, 5)), trial.rng.choice((None, "torrance-sparrow"))
    sparse = trial.rng.random() < 0.5
    return trial.age(trial.request(frames=frames, format=wanted, sparse=sparse), expected="done")


def _is_a_link(trial: Trial) -> Evidence:
    """A link to a folder is that folder."""
    real = trial.folder / "elsewhere" / "real"
    real.mkdir(parents=True)
    if trial.rng.random() < 0.5:
        trial.put_earlier_result(real)
    trial.output.symlink_to(trial.rng.choice((real, Path("elsewhere/real"))))
    return trial.age(trial.request(), output=real, expected="done")


def _leads_nowhere(trial: Trial) -> Evidence:
    trial.output.symlink_to(trial.rng.choice(("absent", trial.output, "/dev/null", "/proc/1")))
    return trial.age(trial.request(), expected="refused")


def _has_an_odd_name(trial: Trial) -> Evidence:
    names = (
        *(
            "ü",
            "材質",
            "🧱",
            "a b",
            " ",
            "-",
            "--help",
            "~",
            "$HOME",
            "*",
            "[x]",
            "?",
            "a\nb",
            "%d",
        ),
        *("\x1b[2J", "x" * 255, "x" * 240, "x" * 200, "out.partial-x", ".hidden", "...", "a.exr"),
        *(os.fsdecode(b"caf\xe9"), "\udcff" * 10, "a'b\"c", "\\", "C:\\aged", "nul", "\u202eevil"),
    )
    output = trial.folder / trial.rng.choice(names)
    # A name of 255 bytes is one that a file system takes.
    return trial.age(trial.request(output=str(output)), output=output, expected="done")


def _has_an_impossible_name(trial: Trial) -> Evidence:
    names = ("x" * 256, "x" * 5000, "a/" * 2500, "x\0y", "\ud800", "in/M_Color.png/out")
    output = trial.folder / trial.rng.choice(names)
    request = trial.request(output=str(output))
    return trial.age(request, writes=False, expected="refused")


def _lies_deep(trial: Trial) -> Evidence:
    output = trial.folder.joinpath(*["deeper"] * trial.rng.choice((1, 3, 30)))
    way = trial.rng.choice((str(output), f"{output}/", f"{output}/.", f"{output}/../{output.name}"))
    return trial.age(trial.request(output=way), output=output, expected="done")


def _is_no_folder(trial: Trial) -> Evidence:
    path = trial.output
    make: Callable[[], object] = trial.rng.choice(
        (lambda: path.write_bytes(b"kept"), lambda: os.mkfifo(path))
    )
    make()
    return trial.age(trial.request(), expected="refused")


def _is_the_input(trial: Trial) -> Evidence:
    """Into the folder that is aged: its own files must stay."""
    output = trial.folder / "in"
    return trial.age(trial.request(output=str(output)), output=output)


def _is_closed(trial: Trial) -> Evidence:
    """Without permission to write, which root does not need."""
    if trial.rng.random() < 0.5:
        trial.put_earlier_result()
    trial.output.mkdir(exist_ok=True)
    trial.rng.choice((trial.output, trial.output.parent)).chmod(0o555)
    try:
        return trial.age(trial.request())
    finally:
        trial.output.parent.chmod(0o755)
        trial.output.chmod(0o755)


def _is_a_mount_point(trial: Trial) -> Evidence:
    with _mounted(trial.output, "size=16m"):
        if trial.rng.random() < 0.5:
            trial.put_earlier_result()
        return trial.age(trial.request(), expected="done")


def _is_a_writable_mount_in_a_closed_one(trial: Trial) -> Evidence:
    place = trial.folder / "closed"
    with _mounted(place, "size=1m"):
        output = place / "out"
        output.mkdir()
        subprocess.run(["mount", "-o", "remount,ro", place], check=True)
        with _mounted(output, "size=16m"):
            request = trial.request(output=str(output))
            return trial.age(request, output=output, expected="done")


def _is_read_only(trial: Trial) -> Evidence:
    place = trial.folder / "closed"
    with _mounted(place, "size=16m"):
        output = place / "out"
        trial.put_earlier_result(output)
        subprocess.run(["mount", "-o", "remount,ro", place], check=True)
        request = trial.request(output=str(output))
        return trial.age(request, output=output, expected="refused")


def _is_on_a_full_disk(trial: Trial) -> Evidence:
    place = trial.folder / "small"
    inside = trial.rng.random() < 0.3
    # The earlier result takes some 80 kB in pages of 4.
    with _mounted(place, f"size={trial.rng.choice((84, 100, 120, 160, 240))}k"):
        output = place if inside else place / "out"
        if trial.rng.random() < 0.7:
            trial.put_earlier_result(output)
        rest = os.statvfs(place)
        spare = rest.f_bavail * rest.f_bsize - trial.rng.choice((0, 4, 20, 60)) * 1024
        (place / "ballast").write_bytes(b"x" * max(0, spare))
        request = trial.request(output=str(output), frames=trial.rng.choice((2, 6)))
        return trial.age(request, output=output)


def _holds_a_file_that_stays(trial: Trial) -> Evidence:
    """A file of the earlier result that nobody may replace or remove."""
    trial.put_earlier_result()
    path = trial.rng.choice(sorted(trial.output.iterdir()))
    if subprocess.run(["chattr", "+i", path], capture_output=True, check=False).returncode:
        return trial.age(trial.request(), expected="done")  # this file system knows no such files
    try:
        return trial.age(trial.request(frames=trial.rng.choice((1, 2, 3))))
    finally:
        for each in trial.folder.rglob(path.name):
            subprocess.run(["chattr", "-i", each], check=True)


_PLACES = (
    *(_holds_files_of_the_user, _holds_files_of_the_user, _holds_folders, _holds_links),
    *(_holds_a_damaged_report, _replaces_another, _is_a_link, _leads_nowhere, _has_an_odd_name),
    *(
        _has_an_odd_name,
        _has_an_impossible_name,
        _lies_deep,
        _is_no_folder,
        _is_the_input,
        _is_closed,
    ),
)
_DISKS = (
    *(_is_a_mount_point, _is_a_writable_mount_in_a_closed_one, _is_read_only, _is_on_a_full_disk),
    *(_is_on_a_full_disk, _holds_a_file_that_stays),
)


@cache
def _may_mount() -> bool:
    """Whether disks may be mounted, which takes root, and more than that in a container."""
    with tempfile.TemporaryDirectory() as place:
        tried = subprocess.run(["mount", "-t", "tmpfs", "tmpfs", place], capture_output=True)
        if tried.returncode == 0:
            subprocess.run(["umount", place], check=True)
        return tried.returncode == 0


@contextmanager
def _mounted(place: Path, options: str) -> Iterator[None]:
    """A small disk at `place`, while the context lasts."""
    place.mkdir(exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", place], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", place], check=True)
