"""How a representation bears damaged input: fewer, missing, noisy, coarse and wrong samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from model_runtime.brdf.half_angle import cosines
from model_runtime.representation.latents import Latents

from ...baselines.encoders import Encoder
from ...data.analytic import random_torrance_sparrow
from ...metric.sphere import Sphere, psnr
from .probes import SAMPLES, SEED, analytic_groups, measured_groups, reflecting, together

__all__ = (
    "DAMAGES",
    "DAMAGE_TITLES",
    "Damage",
    "coarse",
    "measure_stability",
    "read_what_is_there",
)

_KNOWS_GAPS = ("lobes",)
"""Representations that take NaN for a sample that is missing."""

_READS_ALL = ("deepbrdf",)
"""Those that cannot do without any."""

_PER = 258
"""Fireflies are counted in as many samples."""

Ruin = Callable[[Tensor, Tensor, float, torch.Generator], Tensor]


def _fewer(angles: Tensor, f: Tensor, m: float, g: torch.Generator) -> Tensor:
    """Only the first `m` samples."""
    lost = torch.arange(len(angles)) >= m
    return f.masked_fill(lost[:, None], torch.nan)


def _not_grazing(angles: Tensor, f: Tensor, last: float, g: torch.Generator) -> Tensor:
    """No samples with light or eye beyond `last` degrees from the normal."""
    cos_i, cos_o, _, _ = cosines(angles.double())
    lost = torch.minimum(cos_i, cos_o).clamp(-1, 1).acos().rad2deg() > last
    return f.masked_fill(lost[:, None], torch.nan)


def _noisy(angles: Tensor, f: Tensor, percent: float, g: torch.Generator) -> Tensor:
    """Every value off by a normal share of itself."""
    return (f * (1 + percent / 100 * torch.randn(f.shape, generator=g))).clamp_min(0)


def _fireflies(angles: Tensor, f: Tensor, count: float, g: torch.Generator) -> Tensor:
    """`count` of every 258 samples a hundred times too bright, in all channels."""
    hit = torch.rand(f.shape[:2], generator=g).argsort(1).argsort(1)
    hit = hit < round(count * len(angles) / _PER)
    return torch.where(hit[..., None], 100 * f, f)


def _second_channel(angles: Tensor, f: Tensor, factor: float, g: torch.Generator) -> Tensor:
    """The second channel times `factor`; NaN for none."""
    return f * f.new_tensor((1.0, factor, 1.0))


@dataclass(frozen=True)
class Damage:
    """A kind of damage: `ruin`(angles, f [N, M, 3], severity, generator), from harmless to absurd.

    channels: those whose picture counts; the rest is what was ruined and cannot be known
    """

    title: str
    ruin: Ruin
    severities: tuple[float, ...]
    labels: tuple[str, ...]
    channels: tuple[int, ...] = (0, 1, 2)


DAMAGES: Mapping[str, Damage] = {
    "samples": Damage(
        "samples read", _fewer, (258, 128, 64, 32, 16), ("258", "128", "64", "32", "16")
    ),
    "grazing": Damage(
        "nothing beyond", _not_grazing, (80, 70, 60, 50), ("80°", "70°", "60°", "50°")
    ),
    "noise": Damage(
        "noise a sample", _noisy, (1, 2, 5, 10, 20), ("1 %", "2 %", "5 %", "10 %", "20 %")
    ),
    "fireflies": Damage("x100 in 258 samples", _fireflies, (1, 3, 10), ("1", "3", "10")),
    "bad_channel": Damage(
        "one channel bad, the others' picture",
        _second_channel,
        (torch.nan, 0, 10),
        ("missing", "zero", "x10"),
        channels=(0, 2),
    ),
}
_BITS = (8, 6, 5, 4)


def read_what_is_there(model: Encoder, angles: Tensor, f: Tensor) -> Latents | None:
    """Latents of `f` [N, M, 3], where NaN marks what is missing.

    An encoder that knows no gaps is given the samples that are whole, as a shorter list; None
    where some values of a sample are missing and others are not, which it cannot be told, or where
    it has to have all.
    """
    known = f.isfinite()
    if model.name in _KNOWS_GAPS or bool(known.all()):
        return model.encode(angles, f)
    whole = known.all(0).all(-1)
    if model.name in _READS_ALL or bool((known != whole[:, None]).any()):
        return None
    return model.encode(angles[whole], f[:, whole])


def coarse(states: Sequence[Tensor], bits: int) -> tuple[Tensor, Tensor, Tensor]:
    """(kd, ks, alpha) as maps of `bits` bits hold them: kd in sRGB, ks linear, alpha's root."""
    kd, ks, alpha = states
    steps = 2**bits - 1

    def rounded(values: Tensor) -> Tensor:
        return (values.clamp(0, 1) * steps).round() / steps

    srgb = torch.where(kd <= 0.0031308, kd * 12.92, 1.055 * kd.clamp_min(1e-9) ** (1 / 2.4) - 0.055)
    srgb = rounded(srgb)
    kd = torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return kd, rounded(ks), rounded(alpha.sqrt()).square()


@dataclass
class _Curve:
    """Scores at severities; the first point is the undamaged input."""

    model: Encoder
    sphere: Sphere
    truth: Tensor
    clean: Latents
    channels: tuple[int, ...]

    def __post_init__(self) -> None:
        self.spread = float(torch.pdist(self.clean.flat()).median())
        self.labels: list[str] = []
        self.points: list[tuple[float, float, float] | None] = []
        self.add("none", self.clean)

    def add(self, label: str, latents: Latents | None) -> None:
        """Score what was read from damaged input; None leaves a hole."""
        self.labels.append(label)
        if latents is None:
            self.points.append(None)
            return
        shown = self.sphere.render(lambda angles: self.model.decode(latents, angles), chunk=4)
        kept = list(self.channels)
        score = psnr(self.truth[..., kept], shown[..., kept]).mean(1)
        moved = (latents.flat() - self.clean.flat()).norm(dim=1) / self.spread
        self.points.append((float(score.mean()), float(score.min()), float(moved.median())))

    def json(self) -> dict[str, Any]:
        """Lists over severities; None where the method cannot be told."""
        names = ("mean", "min", "displacement")
        return {"labels": self.labels} | {
            name: [None if point is None else round(point[i], 3) for point in self.points]
            for i, name in enumerate(names)
        }


def measure_stability(model: Encoder, data: Path, sphere: Sphere) -> dict[str, Any]:
    """How accuracy and latents change with damage to 16 materials (MERL held out, RGL, Disney,
    Torrance-Sparrow), and with 8-bit and coarser maps to 12 Torrance-Sparrow ones.

    By damage: `labels` of the severities, the first undamaged; `mean` and `min` over materials of
    the PSNR in dB against the undamaged truth; `displacement`, the median distance that latents
    move, over the median distance of the latents of two materials. `bits` also has `input`, the
    mean PSNR of the coarse maps themselves.
    """
    groups = measured_groups(data) | analytic_groups()
    counts = {"merl_held_out": 5, "rgl": 3, "disney": 4, "torrance_sparrow": 4}
    some = together({name: groups[name].first(count) for name, count in counts.items()})
    angles = model.sample_angles(SAMPLES)
    f = some.evaluate(angles)
    clean = model.encode(angles, f)
    truth = sphere.render(some.evaluate, chunk=4)
    report = {}
    for name, damage in DAMAGES.items():
        curve = _Curve(model, sphere, truth, clean, damage.channels)
        for severity, label in zip(damage.severities, damage.labels, strict=True):
            g = torch.Generator().manual_seed(SEED)
            ruined = damage.ruin(angles, f, severity, g)
            curve.add(label, read_what_is_there(model, angles, ruined))
        report[name] = curve.json()
    return report | {"bits": _measure_bits(model, sphere)}


def _measure_bits(model: Encoder, sphere: Sphere) -> dict[str, Any]:
    states = random_torrance_sparrow(12, torch.Generator().manual_seed(SEED + 2))
    fine = reflecting(("",) * 12, *states)
    truth = sphere.render(fine.evaluate, chunk=4)
    curve = _Curve(model, sphere, truth, fine.encoded(model), (0, 1, 2))
    itself = [100.0]
    for bits in _BITS:
        stored = reflecting(fine.names, *coarse(states, bits))
        curve.add(f"{bits} bit", stored.encoded(model))
        itself.append(float(psnr(truth, sphere.render(stored.evaluate, chunk=4)).mean()))
    return curve.json() | {"input": [round(value, 3) for value in itself]}


DAMAGE_TITLES = {name: damage.title for name, damage in DAMAGES.items()} | {
    "bits": "maps of so few bits"
}
