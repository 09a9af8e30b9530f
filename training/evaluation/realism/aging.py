"""What the report `realism` learns from sources and ages with, kept from call to call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import ENCODER
from model_runtime.reading.inputs import hash_file

from ...data.sequences import Sequence
from ...learn import learn, read_change
from ...source.change import sequence_of
from ...source.scan_maps import ScanMaps
from ..bench.kept import code, identity, kept, kept_json
from ..synthesis.sources import Effort, SourceModels
from .methods import Aged, Array, crossfade, formula, ours, papers, stt_of
from .targets import HalvedScan

__all__ = ("Aging", "Learned", "Source", "nearest_in_mean")


@dataclass(frozen=True)
class Learned:
    """A model file, and the seconds of a core that it took to learn."""

    path: Path
    seconds: float


@dataclass(frozen=True)
class Source:
    """What is learned from: the left half of a scan."""

    scan: HalvedScan

    @property
    def key(self) -> str:
        """What it is called in files."""
        return self.scan.name

    @cached_property
    def made_from(self) -> str:
        """What identifies it."""
        return identity(self.scan.made_from, hash_file(ENCODER))

    @cached_property
    def sequence(self) -> Sequence:
        """Its clean texels and their histories, as `training scan` tells them, for methods that
        read colors and gloss in frames and nothing else.
        """
        whole = sequence_of(read_change(self.scan.source, process=self.scan.kind.process))
        return replace(whole, height=None, residue=None, strength=None)


@dataclass(frozen=True)
class Aging:
    """Histories of `times` pictures, `size` texels a side; files are in `folder`. `effort` is spent
    on the paper's method, `minutes` on ours (None: as many as the product does).
    """

    folder: Path
    times: int
    size: int
    effort: Effort
    minutes: float | None

    def learned(
        self, source: Path | ScanMaps | Sequence, key: str, process: str, made_from: str
    ) -> Learned:
        """Ours of a source, as `python -m training learn` makes it."""
        path, record = (self.folder / f"ours_{key}.{end}" for end in ("safetensors", "json"))
        if not path.exists():
            record.unlink(missing_ok=True)

        made_from = identity(made_from, code(), str(self.minutes))

        def make() -> float:
            self.folder.mkdir(parents=True, exist_ok=True)
            start = time.process_time()
            learn(source, path, "learned", process=process, minutes=self.minutes)
            return time.process_time() - start

        return Learned(path, kept_json(record, made_from, make))

    def of_scan(self, source: Source) -> Learned:
        """Ours of the left half of a scan."""
        scan = source.scan
        return self.learned(scan.source, source.key, scan.kind.process, source.made_from)

    def aged(
        self, method: str, key: str, clean: Callable[[], PrincipledMaps], source: Source, ntm: Path
    ) -> Aged:
        """What `method` makes of the material `clean`, called `key`, after `source`; ours with the
        model `ntm`.
        """

        def make() -> dict[str, Tensor]:
            found = self._age(method, clean(), source, ntm)
            tensors = {
                "pictures": _bytes(found.pictures),
                "end": _bytes(found.end),
                "seconds": torch.tensor(found.seconds),
            }
            if found.heights is not None:
                tensors["heights"] = torch.from_numpy(found.heights)
            return tensors

        used = hash_file(ntm) if method == "ours" else str(self.effort)
        made_from = identity(key, source.made_from, used, code(), f"{self.times} {self.size}")
        path = self.folder / f"aged_{key}_{method}.safetensors"
        stored = kept(path, made_from, make)
        heights = stored.get("heights")
        pictures, end = (
            stored[name].numpy().astype(np.float32) / 255 for name in ("pictures", "end")
        )
        raised = None if heights is None else heights.numpy()
        return Aged(pictures, end, raised, float(stored["seconds"]))

    def _age(self, method: str, clean: PrincipledMaps, source: Source, ntm: Path) -> Aged:
        shape = (self.times, self.size)
        if method == "ours":
            return ours(clean, str(ntm), *shape)
        if method == "ours_v1":
            return formula(clean, source.scan.kind.before, *shape)
        if method == "crossfade":
            return crossfade(clean, source.scan.mean_weathered, *shape)
        if method == "stt":
            return stt_of(clean, source.sequence, *shape)
        assert method == "paper"
        models = SourceModels(self.folder, self.effort)
        return papers(clean, source.sequence, *shape, models, source.key)


def _bytes(pictures: Array) -> Tensor:
    return torch.from_numpy(np.rint(255 * pictures).astype(np.uint8))


def nearest_in_mean(pictures: Array, target: Array) -> int:
    """Which of `pictures` [T, H, W, 3] has the mean color of `target` [H, W, 3]."""
    apart = np.square(pictures.mean((1, 2)) - target.mean((0, 1))).sum(1)
    return int(apart.argmin())
