"""STT: spatio-temporal BRDF transfer, a cubic per texel carried over by matching patches.

D. Meister, A. Pospisil, I. Sato, J. Bittner: Spatio-Temporal BRDF: Modeling and Synthesis.
Computers & Graphics 97, 2021; in the paper's section 2 and the rival of its section 4.3. Where the
article is silent, its authors' code (meistdan/tsvbrdf) decides: patches of 5 x 5, equalised
luminance as the only guide, the scale taken per channel. Their randomized PatchMatch with voting
(patented) is replaced by a search tree: every texel takes its own best match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import rankdata

from model_runtime.errors import InputError
from model_runtime.maps import TorranceSparrowMaps
from training.data.sequences import Sequence

__all__ = ("STTModel", "fit")

Doubles = NDArray[np.float64]

_COEFFICIENTS = 4
_PATCH = 5
_REC_709 = (0.2126, 0.7152, 0.0722)
_BLACK = 1e-3
_SLACK = 1.0


@dataclass(frozen=True)
class STTModel:
    """A source as polynomials p(x,y,t) = c0 + c1 t + c2 t^2 + c3 t^3, and where its patches lie.

    kd, ks: [4, H, W, 3] and alpha: [4, H, W], the coefficients c0 .. c3 of every texel
    start: [H, W, 3], Kd of the first frame, which the cubics meet but nearly
    axes: [25, 25] orthonormal, principal axes of the source's patches, the widest first
    tree: the source's H W patches in those axes, in row order
    name: of the source
    """

    kd: Doubles
    ks: Doubles
    alpha: Doubles
    start: NDArray[np.float32]
    axes: Doubles
    tree: KDTree
    name: str

    def match(self, target: TorranceSparrowMaps) -> NDArray[np.intp]:
        """The source texel (index in row order) with the patch nearest to a target texel's: [H, W].

        Patches are compared by the Euclidean distance of their histogram-equalised luminance. The
        match may be up to twice as far as the nearest patch (on average it is 0.1 to 0.7 % farther,
        and three to five times faster to find); a patch that the source holds is found.

        Raises `InputError` for a target smaller than a patch.
        """
        patches = _patches(target.kd, "target")
        _, texels = self.tree.query(patches @ self.axes, eps=_SLACK)
        return texels.reshape(target.size)

    def synthesize(self, target: TorranceSparrowMaps, times: NDArray[np.floating]) -> Sequence:
        """The target's history at `times` [T], in the source's time, unclamped.

        With s the source texel matched to a texel x of the target,

            Kd(x,t) = Kd_s(t) Kd_x / Kd_s(first frame)    per channel
            Ks(x,t) = Ks_s(t),  alpha(x,t) = alpha_s(t)

        so that the target's own Ks and alpha are not looked at. Kd is not scaled where the source
        begins below 0.001, where the ratio says nothing.

        Raises `InputError` for a target smaller than a patch.
        """
        texels = self.match(target)
        start = _at(self.start, texels)
        lit = start > _BLACK
        scale = np.where(lit, target.kd / np.where(lit, start, 1), 1)
        times = np.asarray(times, np.float32)
        return Sequence(
            kd=_evaluated(self.kd, texels, times, scale),
            ks=_evaluated(self.ks, texels, times),
            alpha=_evaluated(self.alpha, texels, times),
            times=times,
            onset=None,
            name=f"{self.name}_stt",
        )


def fit(source: Sequence) -> STTModel:
    """The polynomials of every texel of `source`, by least squares over its frames as they are.

    Raises `InputError` for a source with fewer than four frames or smaller than a patch.
    """
    if len(source.times) < _COEFFICIENTS:
        raise InputError(
            f"STT fits cubics, and the sequence {source.name} has only {len(source.times)} frames.",
            "Give it at least four.",
        )
    patches = _patches(source.kd[0], "source")
    # Turning the patches onto their principal axes keeps distances, and lets the tree split along
    # the few directions in which they differ: three times faster.
    _, axes = np.linalg.eigh(patches.T @ patches)
    axes = np.ascontiguousarray(axes[:, ::-1])
    powers = np.power.outer(source.times.astype(np.float64), range(_COEFFICIENTS))  # [T, 4]
    solve = np.linalg.pinv(powers)
    kd, ks, alpha = (np.tensordot(solve, m, 1) for m in (source.kd, source.ks, source.alpha))
    return STTModel(kd, ks, alpha, source.kd[0], axes, KDTree(patches @ axes), source.name)


def _patches(kd: NDArray[np.float32], role: str) -> Doubles:
    """The 5 x 5 patch of equalised luminance round every texel, mirrored at the edges: [H W, 25].

    Equalised luminance is the share of texels that are darker, ties counted half.
    """
    height, width = kd.shape[:2]
    if min(height, width) < _PATCH:
        raise InputError(
            f"STT compares patches of {_PATCH} x {_PATCH} texels, and the {role} has only"
            f" {width} x {height}.",
            f"Give it a {role} of at least that size; a uniform material may be repeated.",
        )
    luminance = kd @ np.array(_REC_709, np.float32)
    equalised = ((rankdata(luminance) - 0.5) / luminance.size).reshape(height, width)
    padded = np.pad(equalised, _PATCH // 2, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (_PATCH, _PATCH))
    return windows.reshape(-1, _PATCH**2)


def _at(maps: NDArray[np.floating], texels: NDArray[np.intp]) -> NDArray[np.floating]:
    """The values of maps [H, W, ...] at texels given in row order."""
    return maps.reshape(-1, *maps.shape[2:])[texels]


def _evaluated(
    coefficients: Doubles,
    texels: NDArray[np.intp],
    times: NDArray[np.float32],
    scale: Doubles | float = 1.0,
) -> NDArray[np.float32]:
    """Polynomials of the matched texels, scaled, at `times`: [T, H, W, ...]."""
    powers = np.power.outer(times.astype(np.float64), range(_COEFFICIENTS))  # [T, 4]
    matched = np.stack([_at(c, texels) * scale for c in coefficients])
    return np.tensordot(powers, matched, 1).astype(np.float32)
