"""Sequences as folders that `read_sequence` reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from model_runtime.atomic import replaced
from model_runtime.errors import OutputError, reason, shown
from model_runtime.images import write_exr

from .sequences import Sequence

__all__ = ("write_sequence",)

_OURS = "written_by"
_MAPS = ("kd", "ks", "alpha")


def write_sequence(sequence: Sequence, folder: Path, made: Mapping[str, Any]) -> None:
    """Write `sequence`, which has a timing and an onset, to `folder`; what is said of how it was
    `made` (JSON) goes into its `sequence.json`.

    Frames of an earlier sequence of ours in that folder are replaced. Raises OutputError where it
    cannot be written or holds frames that were not written so.
    """
    assert sequence.onset is not None and sequence.timing is not None
    earlier = _earlier_frames(folder)
    described: dict[str, Any] = {
        **made,
        _OURS: "python -m training",
        "times": [float(time) for time in sequence.times],
        "timing": sequence.timing.json(),
    }
    if sequence.sources:
        described["sources"] = [dict(source) for source in sequence.sources]
    if sequence.warnings:
        described["warnings"] = list(sequence.warnings)
    maps = {name: getattr(sequence, name) for name in _MAPS}
    if sequence.height is not None:
        maps["height"] = sequence.height
    alone = {"onset": sequence.onset}
    if sequence.residue is not None:
        grain: dict[str, Any] = {"share": sequence.share}
        if sequence.strength is not None:
            grain["strength"] = [float(each) for each in sequence.strength]
        described["grain"] = grain
        kd, ks = sequence.residue[..., :3], sequence.residue[..., 3:6]
        rough, height = sequence.residue[..., 6], sequence.residue[..., 7]
        alone |= {"grain_kd": kd, "grain_ks": ks, "grain_alpha": rough, "grain_height": height}
    try:
        for file in earlier:
            file.unlink()
        for name, frames in maps.items():
            for k, pixels in enumerate(frames, start=1):
                write_exr(folder / f"{name}_{k:04d}.exr", pixels)
        for name, pixels in alone.items():
            write_exr(folder / f"{name}.exr", pixels)
        with replaced(folder / "sequence.json") as file:
            file.write_text(json.dumps(described, indent=1), encoding="utf-8")
    except OSError as error:
        raise _unwritable(folder, error) from error


def _earlier_frames(folder: Path) -> list[Path]:
    """Maps that an earlier sequence of ours left in `folder`, which is made where there is none.

    Raises OutputError where it cannot be, or where the frames are somebody else's.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = (*(f"{name}_*" for name in (*_MAPS, "height")), "grain_*")
        found = [file for name in names for file in folder.glob(f"{name}.exr")]
        described = folder / "sequence.json"
        ours = described.is_file() and f'"{_OURS}"' in described.read_text(errors="replace")
    except OSError as error:
        raise _unwritable(folder, error) from error
    if found and not ours:
        raise OutputError(
            f"{shown(folder)} holds frames that this command has not written.",
            "Choose another folder.",
        )
    return found


def _unwritable(folder: Path, error: OSError) -> OutputError:
    return OutputError(
        f"The sequence cannot be written to {shown(folder)} ({reason(error)}).",
        "Choose a folder that can be written.",
    )
