"""Small materials and runs for the tests of aging."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from model_runtime.age import AgeRequest, age
from model_runtime.images import read_image, write_exr

PRINCIPLED = ("base_color", "metallic", "specular", "roughness")
TORRANCE_SPARROW = ("kd", "ks", "alpha")
LOBES = ("second_color", "second_edge", "third_color", "third_edge")
COLORS = ("base_color", "specular_tint", "kd", "ks", *LOBES)


@dataclass
class Listener:
    """Hears how a run goes; says stop at the `stop_at`-th question."""

    stop_at: int | None = None
    fractions: list[float] = field(default_factory=list)
    stages: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    asked: int = 0

    def progress(self, stage: str, fraction: float) -> None:
        self.fractions.append(fraction)
        self.stages.append(stage)

    def warning(self, message: str) -> None:
        self.warnings.append(message)

    def cancelled(self) -> bool:
        self.asked += 1
        return self.stop_at is not None and self.asked >= self.stop_at


def run(source: Path, output: Path, listener: Listener | None = None, **options) -> dict[str, Any]:
    request = AgeRequest(source, options.pop("ntm", "rust"), output, **options)
    return age(request, listener or Listener())


def frames_of(folder: Path, name: str, frames: int) -> np.ndarray:
    """[T, H, W] or [T, H, W, 3]"""
    return np.stack(
        [
            read_image(folder / f"{name}_{k:04d}.exr", color=name in COLORS)
            for k in range(1, frames + 1)
        ]
    )


def halves(pixels: np.ndarray) -> np.ndarray:
    """As half floats hold them."""
    return pixels.astype(np.float16).astype(np.float32)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def smooth_noise(size: int, seed: int) -> np.ndarray:
    """[size, size] in 0..1"""
    rng = np.random.default_rng(seed)
    coarse = rng.random((size // 4, size // 4))
    return np.kron(coarse, np.ones((4, 4))) * 0.8 + 0.2 * rng.random((size, size))


def write_painted_steel(folder: Path, size: int) -> Path:
    """A Principled material: worn green paint on steel, every map varying."""
    folder.mkdir()
    bare = smooth_noise(size, 1)[..., None] > 0.6
    shade = 0.7 + 0.3 * smooth_noise(size, 2)[..., None]
    base = np.where(bare, (0.55, 0.54, 0.52), (0.05, 0.22, 0.10)) * shade
    write_exr(folder / "BaseColor.exr", base.astype(np.float32))
    write_exr(folder / "Metallic.exr", bare[..., 0].astype(np.float32))
    roughness = 0.25 + 0.4 * smooth_noise(size, 3)
    write_exr(folder / "Roughness.exr", roughness.astype(np.float32))
    return folder


def write_torrance_sparrow(
    folder: Path, kd=(0.02, 0.02, 0.02), ks=(0.5, 0.49, 0.47), alpha=0.1, size: int = 1
) -> Path:
    folder.mkdir()
    for name, value in (("kd", kd), ("ks", ks)):
        write_exr(folder / f"{name}.exr", np.broadcast_to(np.float32(value), (size, size, 3)))
    write_exr(folder / "alpha.exr", np.full((size, size), alpha, np.float32))
    return folder
