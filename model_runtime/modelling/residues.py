"""What texels show beyond their histories: grain, each its own, and relief."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from ..backend import Tensor, functional, torch
from ..channels import KS, WIDTH
from ..contract import AgeRequest, Specular
from ..surface.atlas import Atlas
from ..surface.laying import lay_grain, tile_side
from ..temporal.ntm import NeuralTemporalModel
from ..temporal.wear import Course

__all__ = ("HEIGHT_PLACE", "LEAST_GRAIN", "Laid", "Residues", "lay")

HEIGHT_PLACE = WIDTH
"""Where the height lies in shapes, after the channels of a state."""

LEAST_GRAIN = 3
"""Components of grain, the first of which show most, that a live material always has room for."""


@dataclass(frozen=True)
class Residues:
    """What n texels add to their histories at each age: sum_j g_j W_j(a), to states with roughness
    and to heights, and H(a) to heights alone.

    coefficients: g [R, n], halves
    shapes: W [R, T, C + 1], 0 at age 0
    height: H [T], 0 at age 0; heights are in sides of the grain's tile
    grain: how many coefficients, the last ones, are grain
    """

    coefficients: Tensor
    shapes: Tensor
    height: Tensor
    grain: int

    @classmethod
    def of(
        cls,
        ntm: NeuralTemporalModel,
        components: Tensor | None,
        *,
        worn: Tensor | None = None,
        specular: Specular = "rgb",
    ) -> Residues | None:
        """Those of a model whose grain has these `components` [K, n] halves in each texel; None
        where it adds nothing.

        What is `worn` already, [n] from 0 to 1, has grain and relief of its own. With `specular`
        "mono" all colors of Ks change alike.
        """
        shapes, coefficients = torch.zeros(0, ntm.frames, WIDTH + 1), []
        height = torch.zeros(ntm.frames) if ntm.height is None else ntm.height
        if worn is not None and height.any():
            coefficients.append(-worn.half()[None])
            shapes = functional.pad(height[None, :, None], (HEIGHT_PLACE, 0))
        grain = 0
        if ntm.grain is not None and components is not None:
            own = torch.from_numpy(ntm.grain.shapes).transpose(0, 1).clone()
            if specular == "mono":
                own[..., KS] = own[..., KS].mean(-1, keepdim=True)
            coefficients.append(components if worn is None else components * (1 - worn.half()))
            shapes, grain = torch.cat((shapes, own)), len(own)
        if not grain and not height.any():
            return None
        planes = torch.cat(coefficients) if coefficients else torch.zeros(0, 1, dtype=torch.half)
        return cls(planes, shapes, height, grain)

    @property
    def raises(self) -> bool:
        """Whether any height changes."""
        return bool(self.height.any() or self.shapes[..., HEIGHT_PLACE].any())

    @cached_property
    def largest(self) -> Tensor:
        """[R]: the size of the largest of each coefficient, above 0."""
        return self.coefficients.abs().amax(1).float().clamp_min(1e-6)

    def shapes_at(self, ages: Tensor) -> Tensor:
        """[R, A, C + 1] at `ages` [A] from 0 to 1, in straight lines between its own."""
        return _between(self.shapes.transpose(0, 1), ages).transpose(0, 1)

    def height_at(self, ages: Tensor) -> Tensor:
        """[A], likewise."""
        return _between(self.height, ages)

    def averaged(self, ages: Tensor) -> Residues:
        """Those of texels that show means over a source's timing, `ages` [T, T]
        (`Timing.mean_of_ages`).
        """
        shapes = torch.einsum("ta,rac->rtc", ages, self.shapes)
        return replace(self, shapes=shapes, height=ages @ self.height)

    def within(self, room: int) -> Residues:
        """Those with at most so many coefficients: what is worn then has the relief of the others,
        and of the grain what shows least is left out.
        """
        if len(self.shapes) <= room:
            return self
        first, grain = len(self.shapes) - self.grain, min(self.grain, room)
        kept = slice(first, first + grain)
        return replace(
            self, coefficients=self.coefficients[kept], shapes=self.shapes[kept], grain=grain
        )

    def select(self, rows: Tensor) -> Residues:
        """Only those of the texels `rows`."""
        if len(self.coefficients) == 0:
            return self
        return replace(self, coefficients=self.coefficients[:, rows])


def _between(curve: Tensor, ages: Tensor) -> Tensor:
    """The values [A, ...] of a curve [T, ...] over evenly spaced ages, at `ages` [A]."""
    place = ages * (len(curve) - 1)
    lower = place.long().clamp_max(len(curve) - 2)
    share = (place - lower).reshape(-1, *[1] * (curve.ndim - 1))
    return torch.lerp(curve[lower], curve[lower + 1], share.to(curve.dtype))


@dataclass(frozen=True)
class Laid:
    """Residues of a map's texels, None where there are none, and how large the grain's tile is that
    heights are told in: its `side` in meters where `in_meters`, else as a share of the longer side
    of the map.
    """

    residues: Residues | None
    side: float
    in_meters: bool

    @property
    def unit(self) -> float:
        """What heights are multiplied by where they are written: meters, or sides of the tile."""
        return self.side if self.in_meters else 1.0


def lay(
    ntm: NeuralTemporalModel,
    request: AgeRequest,
    size: tuple[int, int],
    *,
    atlas: Atlas | None,
    course: Course | None,
    initial: Tensor,
) -> Laid:
    """The residues of a map of `size` of texels `initial` [n, C], of which those on the `course`
    are worn already: on the surface that `atlas` shows, or in a tile that wraps.
    """
    grain = ntm.grain
    side = 1.0 if grain is None else grain.share
    if atlas is not None:
        side = tile_side(atlas, ntm.card.process, side, pattern_size=request.pattern_size)
    components = None
    if grain is not None and request.grain > 0:
        if atlas is not None:
            planes = lay_grain(grain, atlas, size, side=side, seed=request.seed)
        else:
            planes = grain.in_tile(size, request.seed).T
        components = torch.from_numpy(planes)
        if request.grain < 1:
            components *= request.grain
    has_any = components is not None or ntm.height is not None
    worn = course.share_of(initial) if course is not None and has_any else None
    residues = Residues.of(ntm, components, worn=worn, specular=request.specular)
    return Laid(residues, side, atlas is not None)
