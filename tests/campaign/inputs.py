"""Folders of textures as nobody should leave them, and measured files."""

from __future__ import annotations

import os
import shutil
import stat
import struct
from pathlib import Path

import numpy as np

from .damage import damaged
from .evidence import Evidence
from .images import picture
from .trial import Trial

__all__ = ("attempt_folder", "attempt_measured")

_STEMS = (
    *("Color", "M_Color", "m_color_2k", "M-BaseColor-4096px", "T_Rock_Albedo", "Wood COL", "diff"),
    *("N_Color", "M_Color_Color", "_Color", "color.color", "arm", "M_ORM", "M_Glossiness", "ior"),
    *(
        "M_Normal",
        "M_AO",
        "preview",
        "kd",
        "ks",
        "alpha",
        "KD",
        "材質_Color",
        "🧱_color",
        "M_Çolor",
    ),
    *("\u202eroloC_M", "M\n_Color", "\x1b[31mM_Color", "x" * 240 + "_Color", "a_" * 100 + "Color"),
    *(
        "M_99999999999999999999k_Color",
        "M_" + "9" * 200 + "px_Color",
        "Color" * 40,
        "-Color",
        "%s_Color",
    ),
    *("M_Color\udcff", " Color ", ".Color", "..Color", "M_Color.", "CON_Color", "M_Roughness"),
)
_EXTENSIONS = (
    ".png",
    ".png",
    ".png",
    ".PNG",
    ".jpg",
    ".jpeg",
    ".tif",
    ".exr",
    ".EXR",
    "",
    ".png.bak",
)

_MOVED = ".moved"


def attempt_folder(trial: Trial) -> list[Evidence]:
    """A texture folder with some of its files added, renamed, removed or made something else."""
    folder = trial.textures()
    if trial.rng.random() < 0.06:
        shutil.rmtree(folder)
        trial.rng.choice((lambda: None, folder.mkdir, folder.touch, lambda: os.mkfifo(folder)))()
    else:
        for _ in range(trial.rng.choice((1, 1, 2, 3))):
            trial.rng.choice(_CHANGES)(trial, folder)
    return [trial.age(trial.request(size=trial.rng.choice((None, 4))))]


def _taken(trial: Trial, folder: Path) -> Path:
    """The path of a map, whose file has been taken away; links are never written through."""
    path = _map(trial, folder)
    path.unlink()
    return path


def _map(trial: Trial, folder: Path) -> Path:
    """One of the honest files that are left, or one more."""
    files = [
        path
        for path in folder.iterdir()
        if path.is_file() and not path.is_symlink() and path.suffix != _MOVED
    ]
    if not files:
        files = [folder / "M_Specular.png"]
        files[0].write_bytes(b"")
    return trial.rng.choice(sorted(files))


def _free(trial: Trial, folder: Path) -> Path:
    """An odd path where nothing lies."""
    while True:
        path = folder / (trial.rng.choice(_STEMS) + trial.rng.choice(_EXTENSIONS))
        if not os.path.lexists(path):
            return path


def _add(trial: Trial, folder: Path) -> None:
    source = trial.samples.textures / trial.rng.choice(("M_Color.png", "M_Roughness.png"))
    shutil.copy(source, _free(trial, folder))


def _add_picture(trial: Trial, folder: Path) -> None:
    extension, content = picture(trial)
    stem = trial.rng.choice(("M_Specular", "M_Gloss", "N_Roughness", "M_specular_tint"))
    path = folder / f"{stem}{extension}"
    if not os.path.lexists(path):
        path.write_bytes(content)


def _rename(trial: Trial, folder: Path) -> None:
    _map(trial, folder).rename(_free(trial, folder))


def _remove(trial: Trial, folder: Path) -> None:
    _taken(trial, folder)


def _pipe(trial: Trial, folder: Path) -> None:
    os.mkfifo(_taken(trial, folder))


def _socket(trial: Trial, folder: Path) -> None:
    os.mknod(_taken(trial, folder), stat.S_IFSOCK | 0o600)


def _link(trial: Trial, folder: Path) -> None:
    path = _map(trial, folder)
    elsewhere, inside = trial.folder / "elsewhere.png", folder / f"{path.stem}{_MOVED}"
    path.rename(elsewhere)
    os.link(elsewhere, inside)
    targets = (elsewhere, inside, path, folder, "/dev/zero", "/dev/full", "absent", "/etc/hostname")
    path.symlink_to(trial.rng.choice(targets))


def _folder_instead(trial: Trial, folder: Path) -> None:
    _taken(trial, folder).mkdir()


def _closed(trial: Trial, folder: Path) -> None:
    """Without permission, which root does not need."""
    trial.rng.choice((folder, _map(trial, folder))).chmod(trial.rng.choice((0, 0o200, 0o400)))


def _crowd(trial: Trial, folder: Path) -> None:
    for k in range(1000):
        (folder / f"{k}_{trial.rng.choice(('Color', 'Normal', 'note'))}.png").touch()


def _blank(trial: Trial, folder: Path) -> None:
    """An empty file, or one that claims a terabyte."""
    path = _map(trial, folder)
    path.write_bytes(b"")
    os.truncate(path, trial.rng.choice((0, 0, 1 << 40)))


_CHANGES = (
    *(_add, _add, _add, _add_picture, _rename, _rename, _remove, _pipe, _socket, _link, _link),
    *(_folder_instead, _closed, _crowd, _blank),
)


def attempt_measured(trial: Trial) -> list[Evidence]:
    """A damaged or absurd `.bsdf` or, less often because of its size, `.binary`."""
    rng = trial.rng
    merl = rng.random() < 0.25
    content = _merl(trial) if merl else _rgl(trial)
    path = trial.folder / f"measured{'.binary' if merl else '.bsdf'}"
    if rng.random() < 0.05:
        path = path.with_suffix(rng.choice((".BINARY", ".bsdf", ".binary", ".Bsdf")))
    path.write_bytes(content)
    request = trial.request(
        input=str(path),
        onset=rng.choice(("none", "auto")),
        size=rng.choice((4, 8)),
        specular=rng.choice(("rgb", "mono")),
    )
    return [trial.age(request)]


def _merl(trial: Trial) -> bytes:
    rng, content = trial.rng, trial.samples.merl
    table = np.frombuffer(content, "<f8", offset=12).copy()
    match rng.randrange(5):
        case 0:
            return damaged(content, rng)
        case 1:
            grid = [rng.choice((90, 180, 0, -1, 1, 2**31 - 1)) for _ in range(3)]
            return struct.pack("<3i", *grid) + content[12:]
        case 2:
            table[rng.randrange(len(table))] = rng.choice(_ABSURD)
        case 3:
            start = rng.randrange(len(table))
            table[start : start + rng.choice((1000, 10**6))] = rng.choice(_ABSURD)
        case 4:
            table *= rng.choice((*_ABSURD, 1e-30, 0.0, 1.0))
    return content[:12] + table.tobytes()


def _rgl(trial: Trial) -> bytes:
    rng, content = trial.rng, bytearray(trial.samples.rgl)
    if rng.random() < 0.5:
        return damaged(bytes(content), rng)
    header = content.rfind(b"rgb") + 60  # the tables come after their description
    for _ in range(rng.choice((1, 4, 50))):
        at = rng.randrange(header, len(content) - 4)
        struct.pack_into("<f", content, at, rng.choice((*_ABSURD, 0.0, 1.0)))
    return bytes(content)


_ABSURD = (float("nan"), float("inf"), -float("inf"), 1e30, 3e38, -1.0, -1e30, 1e-38, 1e10)
