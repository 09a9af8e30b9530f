"""One half of a real sequence, aged after the other: by ours, and by what starts from noise."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from model_runtime.age import AgeRequest
from model_runtime.contract import FRAMES, PRINCIPLED, TORRANCE_SPARROW, frame_file
from model_runtime.images import read_image, write_exr
from model_runtime.reading.inputs import hash_file

from ...baselines import ode
from ...data.sequences import Sequence
from ...metric.texture import encoded
from ..bench.aging import age_silently
from ..bench.encoders import WEIGHTS
from ..bench.kept import code, identity, kept
from .aging import Aging, Learned
from .methods import Array
from .spots import Lapse, halves_of

__all__ = ("CONTINUES", "FROM_NOISE", "Continued", "aged_pictures", "learned_half")

FROM_NOISE = WEIGHTS / "ode.safetensors"
"""What `training.baselines.ode` learned from the upper half of the copper's film."""

_FILMS = 4


@dataclass(frozen=True)
class Continued:
    """Pictures [T, H, W, 3] (sRGB) at as many even times, and the seconds that they took."""

    pictures: Array
    seconds: float


def learned_half(lapse: Sequence, kind: Lapse, aging: Aging) -> Learned:
    """Ours of the half that is learned from: of a film of it, or of the sequence."""
    half = halves_of(lapse.kd)[kind.learned]
    made_from = identity(torch.from_numpy(np.ascontiguousarray(half)), kind.process)
    with tempfile.TemporaryDirectory() as folder:
        source = _film(half, Path(folder) / "film") if kind.filmed else _albedo(half, lapse)
        return aging.learned(source, lapse.name, kind.process, made_from)


def continued(lapse: Sequence, kind: Lapse, aging: Aging) -> Continued:
    """The first frame of the half that is met, aged by ours: as a metal, or as diffuse albedo."""
    learned = learned_half(lapse, kind, aging)
    start = halves_of(lapse.kd)[kind.met][0]
    height, width = start.shape[:2]
    if kind.filmed:
        # As often as `learn` takes a film to lie in a material's side: grain has its own size.
        start = np.tile(start, (_FILMS, _FILMS, 1))
        maps = {"base_color": start, "metallic": np.ones_like(start[..., 0])}
    else:
        first = _albedo(start[None], lapse)
        maps = {"kd": start, "ks": first.ks[0], "alpha": first.alpha[0]}

    def make() -> Array:
        return aged_pictures(maps, learned.path, len(lapse.times))[:, :height, :width]

    starts = torch.from_numpy(np.ascontiguousarray(start))
    made_from = identity(starts, str(hash_file(learned.path)))
    return _kept(aging.folder / f"continued_{lapse.name}.safetensors", made_from, make)


def from_noise(lapse: Sequence, kind: Lapse, aging: Aging) -> Continued:
    """What learned the same half of the film and starts from noise, as large as the other one."""
    height, width = halves_of(lapse.kd)[kind.met].shape[1:3]

    def make() -> Array:
        return ode.play(ode.load_flow(FROM_NOISE), (height, width), lapse.times)

    made_from = identity(str(hash_file(FROM_NOISE)), f"{height} {width}")
    return _kept(aging.folder / f"from_noise_{lapse.name}.safetensors", made_from, make)


CONTINUES = {"ours": continued, "ode": from_noise}
"""By method; the latter has learned copper alone."""


def _kept(path: Path, made_from: str, make: Callable[[], Array]) -> Continued:
    def found() -> dict[str, Tensor]:
        begun = time.process_time()
        pictures = torch.from_numpy(np.rint(255 * make()).astype(np.uint8))
        return {"pictures": pictures, "seconds": torch.tensor(time.process_time() - begun)}

    stored = kept(path, identity(made_from, code()), found)
    return Continued(stored["pictures"].numpy().astype(np.float32) / 255, float(stored["seconds"]))


def aged_pictures(maps: Mapping[str, Array], ntm: Path, times: int) -> Array:
    """Pictures [T, H, W, 3] of what `age` makes of `maps`, by their names; the first is shown."""
    shown = next(iter(maps))
    format = PRINCIPLED if shown == "base_color" else TORRANCE_SPARROW
    with tempfile.TemporaryDirectory() as folder:
        start, output = (Path(folder) / name for name in ("start", "aged"))
        start.mkdir()
        for name, pixels in maps.items():
            write_exr(start / f"{name}.exr", pixels)
        request = AgeRequest(start, str(ntm), output, frames=times, format=format, binding=FRAMES)
        age_silently(request)
        files = [output / frame_file(shown, k) for k in range(times)]
        return encoded(np.stack([read_image(file, color=True) for file in files]))


def _albedo(kd: Array, lapse: Sequence) -> Sequence:
    """Part of a sequence of diffuse albedo."""
    alpha = np.full(kd.shape[:3], lapse.alpha.flat[0], np.float32)
    return replace(lapse, kd=kd, ks=np.zeros_like(kd), alpha=alpha, times=lapse.times[: len(kd)])


def _film(colors: Array, folder: Path) -> Path:
    """A folder of numbered pictures."""
    folder.mkdir()
    for k, frame in enumerate(colors):
        code = np.rint(255 * encoded(frame)).astype(np.uint8)
        Image.fromarray(code).save(folder / f"frame_{k:03d}.png")
    return folder
