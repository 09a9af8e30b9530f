"""Between Blender's Principled BSDF and Torrance-Sparrow, both ways (docs/design.md, Two mappings).

*As authored*: `forward` reads the sockets as Torrance-Sparrow parameters and `read_back` finds the
sockets that give aged parameters and otherwise stay nearest to what the artist set. It extends the
closed form that Khronos published for KHR_materials_pbrSpecularGlossiness, which knows one fixed F0
and one metallic, to a free specular level, a tint, and a preference where several answers fit.

*Exact*: `exact` gives the sockets whose Principled BSDF is the Torrance-Sparrow formula itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..contract import FORMATS, PRINCIPLED, PRINCIPLED_EXACT
from ..maps import Pixels, PrincipledMaps, TorranceSparrowMaps

__all__ = ("EXACT_F0", "PULL", "exact", "forward", "in_format", "read_back", "representable")

EXACT_F0 = 0.8
"""F0 of IOR 17.94: with Specular Tint = Ks / 0.8 the node's Fresnel term is flat."""

_CHUNK = 1 << 15
"""Texels worked on at a time: their intermediate values stay in the cache."""

PULL = 2e-4
"""How strongly the authored metallic is kept: at half this share of Kd or Ks at most."""

_TINY = 1e-30


def forward(maps: PrincipledMaps) -> TorranceSparrowMaps:
    """The Torrance-Sparrow parameters of a Principled material.

    F0 = 2 ((n - 1) / (n + 1))^2 level tint, Kd = base (1 - metallic),
    Ks = metallic base + (1 - metallic) F0, alpha = roughness^2.
    """
    height, width = maps.size
    kd, ks = np.empty((2, 3, height * width), np.float32)
    texels = _Texels.of(maps)
    for part in _chunks(height * width):
        kd[:, part], ks[:, part] = texels[part].forward()
    return TorranceSparrowMaps(
        _image(kd, maps.size), _image(ks, maps.size), np.square(maps.roughness)
    )


def read_back(aged: TorranceSparrowMaps, authored: PrincipledMaps) -> PrincipledMaps:
    """The Principled material nearest to `authored` that has the parameters `aged`.

    Base color, metallic, specular level and roughness change; IOR and specular tint stay. A texel
    whose Kd and Ks are those of `forward(authored)` to the bit keeps its sockets to the bit, and
    roughness does where alpha is. Elsewhere `forward` of the result is `aged` within 1 % wherever
    some Principled material has these parameters, and close to them otherwise; base color,
    metallic and roughness lie in 0 to 1, the level in 0 to 1 or, where it was authored above 1,
    up to there (base color likewise).
    """
    assert aged.size == authored.size, f"{aged.size} is not {authored.size}"
    count = aged.size[0] * aged.size[1]
    base, metallic, level = (np.empty((channels, count), np.float32) for channels in (3, 1, 1))
    texels, kd, ks = _Texels.of(authored), _planes(aged.kd), _planes(aged.ks)
    with np.errstate(all="ignore"):
        for part in _chunks(count):
            found = texels[part].read_back(_cut(kd, part), _cut(ks, part))
            base[:, part], metallic[:, part], level[:, part] = found
    return replace(
        authored,
        base_color=_image(base, aged.size),
        metallic=_image(metallic, aged.size),
        specular=_image(level, aged.size),
        roughness=_roughness(aged.alpha, authored.roughness),
    )


def exact(aged: TorranceSparrowMaps) -> tuple[Pixels, Pixels, Pixels]:
    """(base color [H, W, 3], specular tint [H, W, 3], roughness [H, W]) of the exact mapping.

    Specular Tint = Ks / 0.8, Base Color = Kd / (1 - max_rgb Ks), Roughness = sqrt(alpha), with
    Metallic 0, IOR 17.94 and Specular IOR Level 0.5. Exact where `representable`, else clamped.
    """
    ks = aged.ks.clip(0, EXACT_F0)
    base = aged.kd / (1 - ks.max(-1, keepdims=True))
    return base.clip(0, 1), ks / np.float32(EXACT_F0), np.sqrt(aged.alpha.clip(0, 1))


def in_format(
    aged: TorranceSparrowMaps, format: str, authored: PrincipledMaps | None
) -> dict[str, Pixels]:
    """The maps of `format` by name, in their order; `authored` is needed for "principled" alone."""
    if format == PRINCIPLED_EXACT:
        return dict(zip(FORMATS[format], exact(aged), strict=True))
    if format == PRINCIPLED:
        assert authored is not None
        back = read_back(aged, authored)
        return {name: getattr(back, name) for name in FORMATS[format]}
    return {name: getattr(aged, name) for name in FORMATS[format]}


def representable(aged: TorranceSparrowMaps) -> bool:
    """Whether `exact` is exact in every texel: Ks <= 0.8 and Base Color <= 1."""
    strongest = aged.ks.max(-1)
    return bool((strongest <= EXACT_F0).all() and (aged.kd.max(-1) <= 1 - strongest).all())


class _Texels:
    """Authored sockets of n texels, channels first: base and tint [3, n], the rest [1, n].

    A socket that is one value for all of them has n = 1 and broadcasts.
    """

    def __init__(
        self, base: Pixels, metallic: Pixels, level: Pixels, ior: Pixels, tint: Pixels
    ) -> None:
        self.base, self.metallic, self.level, self.ior, self.tint = base, metallic, level, ior, tint

    @staticmethod
    def of(maps: PrincipledMaps) -> _Texels:
        sockets = (maps.base_color, maps.metallic, maps.specular, maps.ior, maps.specular_tint)
        return _Texels(*(_collapsed(_planes(pixels)) for pixels in sockets))

    def __getitem__(self, part: slice) -> _Texels:
        sockets = (self.base, self.metallic, self.level, self.ior, self.tint)
        return _Texels(*(_cut(planes, part) for planes in sockets))

    def f0_per_level(self) -> Pixels:
        """[1, n]: F0 that Specular IOR Level 1 means, before the tint."""
        ratio = (self.ior - 1) / (self.ior + 1)
        return ratio * ratio * 2

    def forward(self) -> tuple[Pixels, Pixels]:
        """(Kd, Ks), each [3, n]."""
        dielectric = 1 - self.metallic
        ks = self.f0_per_level() * self.level * self.tint * dielectric
        return self.base * dielectric, self.base * self.metallic + ks

    def read_back(self, kd: Pixels, ks: Pixels) -> tuple[Pixels, Pixels, Pixels]:
        """(base [3, n], metallic [1, n], level [1, n]): `nearest` where kd or ks [3, n] differs
        from `forward`, else the authored ones.
        """
        authored = self.base, self.metallic, self.level
        changed = self._changed(kd, ks)
        if not changed.any():
            return authored
        solved = self.nearest(kd, ks)
        if changed.all():
            return solved
        base, metallic, level = (
            np.where(changed, new, old) for new, old in zip(solved, authored, strict=True)
        )
        return base, metallic, level

    def _changed(self, kd: Pixels, ks: Pixels) -> NDArray[np.bool_]:
        """[1, n]: which texels' kd or ks [3, n] are not those of `forward`, to the bit."""
        changed = np.zeros((1, kd.shape[1]), np.bool_)
        for c in range(3):
            channel = slice(c, c + 1)
            one = _Texels(
                self.base[channel], self.metallic, self.level, self.ior, self.tint[channel]
            )
            before_kd, before_ks = one.forward()
            changed |= before_ks != ks[channel]
            changed |= before_kd != kd[channel]
            if changed.all():  # nearly always after one channel
                break
        return changed

    def nearest(self, kd: Pixels, ks: Pixels) -> tuple[Pixels, Pixels, Pixels]:
        """(base [3, n], metallic [1, n], level [1, n]) for aged kd, ks [3, n].

        With q = 1 - m and F = F0's strength along the tint T, the equations are Kd = q B and
        Ks = m B + q F T. Across T (in the plane perpendicular to it) F drops out and leaves
        Ks = m (Kd + Ks), which gives m; along T they give F = ((ks + kd) q - kd) / q^2, which must
        lie in 0 to its largest value F1. F >= 0 is q >= kd / (ks + kd); F <= F1 holds outside the
        roots of F1 q^2 - (ks + kd) q + kd. B up to its largest value B1 needs q >= Kd / B1 and,
        where that leaves q = 0, Ks <= B1. B >= 0 needs q F T <= Ks.
        """
        kd, ks = np.maximum(kd, 0), np.maximum(ks, 0)
        scratch = np.empty_like(kd)

        tint2 = _sum(np.square(self.tint))
        tinted = tint2 > _TINY
        tint = np.where(tinted, self.tint, np.float32(1))
        tint2 = np.where(tinted, tint2, np.float32(3))
        per_level = np.where(tinted, self.f0_per_level(), np.float32(0))
        most_level = np.maximum(self.level, 1)
        most_f0 = per_level * most_level

        kd_along = _sum(np.multiply(kd, tint, out=scratch))
        kd_along /= tint2
        ks_along = _sum(np.multiply(ks, tint, out=scratch))
        ks_along /= tint2
        along = kd_along + ks_along
        across = kd + ks
        across -= np.multiply(along, tint, out=scratch)
        pull = np.square(np.minimum(kd_along, ks_along) * PULL)
        pull += np.square(along * 1e-6)
        pull += _TINY
        np.subtract(ks, np.multiply(ks_along, tint, out=scratch), out=scratch)
        metallic = _sum(np.multiply(scratch, across, out=scratch))
        metallic += pull * self.metallic
        metallic /= _sum(np.square(across, out=across)) + pull

        root = np.sqrt(np.square(along) - 4 * most_f0 * kd_along)  # NaN: every q keeps F <= F1
        root += along
        least = 1 - 2 * kd_along / root
        other = 1 - root / (2 * most_f0)
        most_base = np.maximum(self.base, 1)
        most = ks_along / along
        most[along <= 0] = 1
        np.minimum(most, 1 - _largest(np.divide(kd, most_base, out=scratch)), out=most)
        # a full metal has Ks in its base color alone
        beyond = (most == 1) & (_largest(np.subtract(ks, most_base, out=scratch)) > 0)
        np.minimum(most, other, out=most, where=beyond)
        np.minimum(metallic, most, out=metallic)
        gap = np.flatnonzero((metallic > other) & (metallic < least))
        if len(gap):
            m, above, below = metallic[0, gap], least[0, gap], other[0, gap]
            # a root at 0 may come out a rounding error below it
            down = (below > -1e-6) & ((m - below < above - m) | (above > most[0, gap]))
            metallic[0, gap] = np.where(down, below, above)
        np.clip(np.minimum(metallic, most, out=metallic), 0, 1, out=metallic)

        q = 1 - metallic
        f0 = along * q
        f0 -= kd_along
        f0 /= np.square(q)
        share = np.divide(ks, tint, out=scratch)
        if not (tint > _TINY).all():
            share = np.where(tint > _TINY, share, np.float32(math.inf))
        np.minimum(f0, _least(share) / q, out=f0)
        np.minimum(np.fmax(f0, 0, out=f0), most_f0, out=f0)  # fmax: 0 where it is NaN
        base = np.subtract(ks, np.multiply(q * f0, tint, out=scratch), out=ks)
        base *= metallic
        base += np.multiply(q, kd, out=scratch)
        base /= np.square(q) + np.square(metallic)
        np.minimum(np.maximum(base, 0, out=base), most_base, out=base)
        level = np.minimum(f0 / per_level, most_level)
        free = (q == 0) | (per_level == 0)
        if free.any():
            level = np.where(free, self.level, level)
        return base, metallic, level


def _chunks(count: int) -> Iterator[slice]:
    for start in range(0, count, _CHUNK):
        yield slice(start, min(start + _CHUNK, count))


def _planes(pixels: Pixels) -> Pixels:
    """[C, H W] of [H, W, C] or [H, W]; a view where the texels lie evenly."""
    return pixels.reshape(pixels.shape[0] * pixels.shape[1], -1).T


def _image(planes: Pixels, size: tuple[int, int]) -> Pixels:
    """[H, W, 3] or [H, W] of [3, H W] or [1, H W]: `_planes` the other way, a view."""
    return planes.T.reshape(*size, 3) if len(planes) == 3 else planes.reshape(size)


def _collapsed(planes: Pixels) -> Pixels:
    """[C, 1] where the planes [C, n] are one value broadcast, else as they are."""
    return planes[:, :1] if planes.strides[1] == 0 else planes


def _cut(planes: Pixels, part: slice) -> Pixels:
    return planes if planes.shape[1] == 1 else np.ascontiguousarray(planes[:, part])


def _sum(planes: Pixels) -> Pixels:
    total = planes[:1] + planes[1:2]
    total += planes[2:]
    return total


def _least(planes: Pixels) -> Pixels:
    least = np.minimum(planes[:1], planes[1:2])
    return np.minimum(least, planes[2:], out=least)


def _largest(planes: Pixels) -> Pixels:
    largest = np.maximum(planes[:1], planes[1:2])
    return np.maximum(largest, planes[2:], out=largest)


def _roughness(alpha: Pixels, authored: Pixels) -> Pixels:
    """sqrt(alpha), and `authored` where alpha is its square to the bit."""
    kept = alpha == np.square(authored)
    roughness = np.sqrt(np.clip(alpha, 0, 1))
    np.copyto(roughness, authored, where=kept)
    return roughness
