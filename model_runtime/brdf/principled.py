"""Between Blender's Principled BSDF and Torrance-Sparrow, both ways (DESIGN.md, Two mappings).

*As authored*: `forward` reads the sockets as Torrance-Sparrow parameters and `read_back` finds the
sockets that give aged parameters and otherwise stay nearest to what the artist set. It extends the
closed form that Khronos published for KHR_materials_pbrSpecularGlossiness, which knows one fixed F0
and one metallic, to a free specular level, a tint, and a preference where several answers fit.

*Exact*: `exact` gives the sockets whose Principled BSDF is the Torrance-Sparrow formula itself.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ..maps import Pixels, PrincipledMaps, TorranceSparrowMaps

__all__ = ("EXACT_F0", "exact", "forward", "read_back", "representable")

EXACT_F0 = 0.8
"""F0 of IOR 17.94: with Specular Tint = Ks / 0.8 the node's Fresnel term is flat."""

_CHUNK = 10_000
"""Texels worked on at a time: their intermediate values stay in the cache, and torch, which shares
tensors of more than 32,768 numbers out among threads, leaves the threads to the caller's frames."""

_PULL = 2e-4
"""How strongly the authored metallic is kept: at half this share of Kd or Ks at most."""

_TINY = 1e-30


def forward(maps: PrincipledMaps) -> TorranceSparrowMaps:
    """The Torrance-Sparrow parameters of a Principled material.

    F0 = 2 ((n - 1) / (n + 1))^2 level tint, Kd = base (1 - metallic),
    Ks = metallic base + (1 - metallic) F0, alpha = roughness^2.
    """
    height, width = maps.size
    kd, ks = np.empty((2, height * width, 3), np.float32)
    flat = _Texels.of(maps)
    for chunk in flat.chunks():
        part_kd, part_ks = flat[chunk].forward()
        kd[chunk], ks[chunk] = part_kd.T, part_ks.T
    shape = (height, width, 3)
    return TorranceSparrowMaps(kd.reshape(shape), ks.reshape(shape), maps.roughness**2)


def read_back(aged: TorranceSparrowMaps, authored: PrincipledMaps) -> PrincipledMaps:
    """The Principled material nearest to `authored` that has the parameters `aged`.

    Base colour, metallic, specular level and roughness change; IOR and specular tint stay. A texel
    whose Kd and Ks are those of `forward(authored)` to the bit keeps its sockets to the bit, and
    roughness does where alpha is. Elsewhere `forward` of the result is `aged` within 1 % wherever
    some Principled material has these parameters, and close to them otherwise; base colour,
    metallic and roughness lie in 0 to 1, the level in 0 to 1 or, where it was authored above 1,
    up to there (base colour likewise).
    """
    assert aged.size == authored.size, f"{aged.size} is not {authored.size}"
    flat = _Texels.of(authored)
    base = _rows(authored.base_color).clone()
    metallic, level = flat.metallic.clone(), flat.level.clone()
    kd, ks = _rows(aged.kd), _rows(aged.ks)
    for chunk in flat.chunks():
        before_kd, before_ks = flat[chunk].forward()
        changed = ((before_kd != kd[chunk].T) | (before_ks != ks[chunk].T)).any(0)
        rows = changed.nonzero()[:, 0] + chunk.start
        if len(rows):
            solved = flat[rows].nearest(_channels(kd[rows]), _channels(ks[rows]))
            base[rows], metallic[rows], level[rows] = solved[0].T, solved[1], solved[2]
    return replace(
        authored,
        base_color=base.numpy().reshape(authored.base_color.shape),
        metallic=metallic.numpy().reshape(authored.size),
        specular=level.numpy().reshape(authored.size),
        roughness=_roughness(aged.alpha, authored.roughness),
    )


def exact(aged: TorranceSparrowMaps) -> tuple[Pixels, Pixels, Pixels]:
    """(base colour [H, W, 3], specular tint [H, W, 3], roughness [H, W]) of the exact mapping.

    Specular Tint = Ks / 0.8, Base Color = Kd / (1 - max_rgb Ks), Roughness = sqrt(alpha), with
    Metallic 0, IOR 17.94 and Specular IOR Level 0.5. Exact where `representable`, else clamped.
    """
    ks = aged.ks.clip(0, EXACT_F0)
    base = aged.kd / (1 - ks.max(-1, keepdims=True))
    return base.clip(0, 1), ks / np.float32(EXACT_F0), np.sqrt(aged.alpha.clip(0, 1))


def representable(aged: TorranceSparrowMaps) -> bool:
    """Whether `exact` is exact in every texel: Ks <= 0.8 and Base Color <= 1."""
    strongest = aged.ks.max(-1)
    return bool((strongest <= EXACT_F0).all() and (aged.kd.max(-1) <= 1 - strongest).all())


class _Texels:
    """Authored sockets of n texels, channels first: base and tint [3, n], the rest [n]."""

    def __init__(
        self, base: Tensor, metallic: Tensor, level: Tensor, ior: Tensor, tint: Tensor
    ) -> None:
        self.base, self.metallic, self.level, self.ior, self.tint = base, metallic, level, ior, tint

    @staticmethod
    def of(maps: PrincipledMaps) -> _Texels:
        return _Texels(
            _channels(_rows(maps.base_color)),
            torch.from_numpy(maps.metallic.reshape(-1)),
            torch.from_numpy(maps.specular.reshape(-1)),
            torch.from_numpy(maps.ior.reshape(-1)),
            _channels(_rows(maps.specular_tint)),
        )

    def chunks(self):
        for start in range(0, self.metallic.numel(), _CHUNK):
            yield slice(start, start + _CHUNK)

    def __getitem__(self, chunk: slice | Tensor) -> _Texels:
        return _Texels(
            self.base[:, chunk].contiguous(),
            self.metallic[chunk],
            self.level[chunk],
            self.ior[chunk],
            self.tint[:, chunk].contiguous(),
        )

    def f0_per_level(self) -> Tensor:
        """[n]: F0 that Specular IOR Level 1 means, before the tint."""
        return ((self.ior - 1) / (self.ior + 1)).square() * 2

    def forward(self) -> tuple[Tensor, Tensor]:
        """(Kd, Ks), each [3, n]."""
        dielectric = 1 - self.metallic
        f0 = self.f0_per_level() * self.level * self.tint
        return self.base * dielectric, self.base * self.metallic + f0 * dielectric

    def nearest(self, kd: Tensor, ks: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(base [3, n], metallic [n], level [n]) for aged kd, ks [3, n].

        With q = 1 - m and F = F0's strength along the tint T, the equations are Kd = q B and
        Ks = m B + q F T. Across T (in the plane perpendicular to it) F drops out and leaves
        Ks = m (Kd + Ks), which gives m; along T they give F = ((ks + kd) q - kd) / q^2, which must
        lie in 0 to its largest value F1. F >= 0 is q >= kd / (ks + kd); F <= F1 holds outside the
        roots of F1 q^2 - (ks + kd) q + kd. B up to its largest value B1 needs q >= Kd / B1,
        and B >= 0 needs q F T <= Ks.
        """
        kd, ks = kd.clamp_min(0), ks.clamp_min(0)

        tint2 = self.tint.square().sum(0)
        tinted = tint2 > _TINY
        tint = torch.where(tinted, self.tint, 1)
        tint2 = torch.where(tinted, tint2, 3)
        per_level = torch.where(tinted, self.f0_per_level(), 0)
        most_level = self.level.clamp_min(1)
        most_f0 = per_level * most_level

        both = kd + ks
        kd_along = (kd * tint).sum(0) / tint2
        ks_along = (ks * tint).sum(0) / tint2
        along = kd_along + ks_along
        across = both - along * tint
        pull = (torch.minimum(kd_along, ks_along) * _PULL).square() + (along * 1e-6).square()
        pull = pull + _TINY
        agreement = ((ks - ks_along * tint) * across).sum(0)
        metallic = (agreement + pull * self.metallic) / (across.square().sum(0) + pull)

        root = (along.square() - 4 * most_f0 * kd_along).sqrt()  # NaN: every q keeps F <= F1
        least = 1 - 2 * kd_along / (along + root)
        other = 1 - (along + root) / (2 * most_f0)
        gap = (metallic > other) & (metallic < least)
        # a root at 0 may come out a rounding error below it
        nearer = torch.where((other > -1e-6) & (metallic - other < least - metallic), other, least)
        metallic = torch.where(gap, nearer, metallic)
        most_base = self.base.clamp_min(1)
        most = torch.where(along > 0, ks_along / along, 1)
        most = torch.minimum(most, 1 - (kd / most_base).amax(0))
        metallic = torch.minimum(metallic, most).clamp(0, 1)

        q = 1 - metallic
        f0 = (along * q - kd_along) / q.square()
        share = torch.where(tint > 0, ks / tint, math.inf).amin(0) / q
        f0 = torch.minimum(torch.minimum(f0, share).nan_to_num(0).clamp_min(0), most_f0)
        base = (q * kd + metallic * (ks - q * f0 * tint)) / (q.square() + metallic.square())
        base = torch.minimum(base.clamp_min(0), most_base)
        free = (q == 0) | (per_level == 0)
        level = torch.where(free, self.level, torch.minimum(f0 / per_level, most_level))
        return base, metallic, level


def _rows(pixels: Pixels) -> Tensor:
    return torch.from_numpy(pixels.reshape(-1, pixels.shape[-1]))


def _channels(rows: Tensor) -> Tensor:
    return rows.T


def _roughness(alpha: Pixels, authored: Pixels) -> Pixels:
    """sqrt(alpha), and `authored` where alpha is its square to the bit."""
    return np.where(alpha == authored**2, authored, np.sqrt(alpha.clip(0, 1)))
