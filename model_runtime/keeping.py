"""Aging what was aged before: the result that is kept of it takes the place of another run.

What is the very same is told by content: of the input's files, the surface's maps, mask, start
image, models and program, whatever they are called and wherever they lie, and by the settings. So a
result that is taken is to the bit what a run would write.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sysconfig
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL

from .account import command_line
from .age import age
from .backend import NAME, torch
from .contract import AUTO, CACHE_SECONDS, CPU, EVERYWHERE, LSTM_LATENTS, AgeRequest
from .device import device_of
from .errors import Cancelled, TvbrdfError
from .model_files.weights import ENCODER, ESTIMATOR, find_model
from .output.kept import Kept
from .output.stored import StagedResult
from .reading.inputs import hash_file, input_files
from .run import Reporter, Run
from .surface.maps import surface_files

__all__ = ("age_or_take",)

_PLACES = ("input", "ntm", "output", "onset", "device", "surface", "mask", "light")
"""Settings that say where something is: what is there counts instead."""

_WAITING = "waiting for a run that makes the same"


def age_or_take(request: AgeRequest, reporter: Reporter, kept: Kept) -> dict[str, Any]:
    """As `age`, unless a result of the very same is `kept`, which is then put in its place; what is
    aged is kept.

    Of several processes that are asked for the same at once one ages, and the others take.
    """
    started = time.perf_counter()
    try:
        same = _Same.of(request)
    except (TvbrdfError, OSError):
        return age(request, reporter)  # which says what is wrong
    run = Run(request, reporter)

    def wait() -> None:
        if reporter.cancelled():
            raise Cancelled
        reporter.progress(_WAITING, 0.0)

    with kept.alone(same.key, wait):
        if kept.has(same.key) and (found := _taken(run, same, kept, started)) is not None:
            return found
        aged = age(request, reporter)
        # What has changed meanwhile may have been read before it did, or after.
        if not _fell_back(aged, same.device) and _Same.of(request) == same:
            kept.keep(same.key, request.output, aged)
        return aged


def _fell_back(aged: dict[str, Any], device: str) -> bool:
    """Whether a GPU failed, which it may not do the next time."""
    return aged["temporal_model"] == LSTM_LATENTS and aged["device"] == CPU != device


def _taken(run: Run, same: _Same, kept: Kept, started: float) -> dict[str, Any] | None:
    """The report of the result that was kept, now in the output folder; None where it was not
    whole.
    """
    run.progress("read", 0.0)
    with StagedResult(run.request.output) as staged:
        report = kept.take(same.key, staged.write_file)
        if report is None:
            return None
        for warning in report["warnings"]:
            run.warn(warning)
        run.progress("write", 0.9)
        staged.finish()
        report |= {
            "command": command_line(run.request),
            "onset": run.request.onset,
            "hashes": {name: same.hashes[name] for name in report["hashes"]},
            CACHE_SECONDS: round(time.perf_counter() - started, 3),
        }
        staged.commit(report)
    return report


@dataclass(frozen=True)
class _Same:
    """What a result follows from, as a `key`; the `hashes` of files as `aged.json` has them; and
    the device that is to be used.
    """

    key: str
    hashes: dict[str, Any]
    device: str

    @classmethod
    def of(cls, request: AgeRequest) -> _Same:
        """Raises a kind of TvbrdfError, or OSError, where something is not there."""
        device = str(device_of(request.device))
        inputs = {name: _Content.of(file) for name, file in input_files(request.input).items()}
        folder = request.surface or request.input
        maps = surface_files(folder) if folder.is_dir() else {}
        surface = {name: _Content.of(file) for name, file in maps.items()}
        image = None if request.onset in (AUTO, EVERYWHERE) else Path(request.onset)
        files = {
            "ntm": find_model(request.ntm),
            "encoder": ENCODER,
            "estimator": ESTIMATOR,
            "mask": request.mask,
            "light": request.light,
            "onset": image,
        }
        others = {name: _Content.of(file) for name, file in files.items() if file is not None}
        settings = {
            field.name: getattr(request, field.name)
            for field in dataclasses.fields(request)
            if field.name not in _PLACES
        }
        known = {
            "input": {name: each.told for name, each in inputs.items()},
            "surface": {name: each.told for name, each in surface.items()},
            "others": {name: each.told for name, each in others.items()},
            "settings": settings | {"onset": request.onset if image is None else None},
            "device": device if device == CPU else [device, torch.cuda.get_device_name(device)],
            "program": _program(),
        }
        words = json.dumps(known, sort_keys=True)
        hashes: dict[str, Any] = {name: each.digest for name, each in others.items()}
        for name, found in (("input", inputs), ("surface", surface)):
            hashes[name] = {each.name: each.digest for each in found.values()}
        return cls(hashlib.sha256(words.encode()).hexdigest(), hashes, device)


@dataclass(frozen=True)
class _Content:
    """What is in a file, and what it is called: only its kind counts of that."""

    name: str
    digest: str

    @classmethod
    def of(cls, file: Path) -> _Content:
        return cls(file.name, hash_file(file))

    @property
    def told(self) -> tuple[str, str]:
        return Path(self.name).suffix.lower(), self.digest


@lru_cache(maxsize=1)
def _program() -> dict[str, str]:
    """What computes: this program, by its very code, the libraries and the machine's kind."""
    code = hashlib.sha256()
    folder = Path(__file__).parent
    for file in sorted(folder.rglob("*.py")):
        code.update(f"{file.relative_to(folder).as_posix()}\0".encode())
        code.update(file.read_bytes() + b"\0")
    return {
        "code": code.hexdigest(),
        "backend": f"{NAME} {getattr(torch, '__version__', '')}",
        "numpy": np.__version__,
        "images": f"{getattr(OpenEXR, '__version__', '')} {PIL.__version__}",
        "platform": sysconfig.get_platform(),
    }
