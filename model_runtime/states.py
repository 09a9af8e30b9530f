"""States as tensors [..., C], their channels in the order of `channels`: parts, bounds, sight."""

from __future__ import annotations

from .backend import Tensor, torch
from .channels import ALPHA, CHANNELS, REFLECTANCES
from .maps import TorranceSparrowMaps

__all__ = ("clamped", "joined", "perceptual", "rows_of", "with_reflectances", "with_roughness")


def joined(kd: Tensor, ks: Tensor, alpha: Tensor) -> Tensor:
    """States [..., C] of kd, ks [..., 3] and alpha [...]: the inverse of `channels.optics`."""
    return torch.cat((kd, ks, alpha[..., None]), -1)


def rows_of(maps: TorranceSparrowMaps) -> Tensor:
    """States [H W, C] of maps, a texel after the other."""
    return torch.from_numpy(maps.planes()).T.contiguous()


def with_reflectances(states: Tensor, reflectances: Tensor) -> Tensor:
    """`states` [..., C] with other `reflectances` [..., 6] (kd, ks)."""
    return torch.cat((reflectances, states[..., REFLECTANCES.stop :]), -1)


def with_roughness(states: Tensor) -> Tensor:
    """`states` [..., C] with r = sqrt(alpha), Blender's roughness, in alpha's place."""
    before, after = states[..., : ALPHA.start], states[..., ALPHA.stop :]
    return torch.cat((before, states[..., ALPHA].sqrt(), after), -1)


def clamped(states: Tensor) -> Tensor:
    """`states` [..., C] as they can be rendered: every channel in its range (`CHANNELS`)."""
    return torch.cat(
        [states[..., place].clamp(least, most) for place, least, most in CHANNELS.values()], -1
    )


def perceptual(states: Tensor, *, least: float = 0.0, most: float = 4.0) -> Tensor:
    """`states` [..., C] so that equal steps look about equally large; beyond `least` and `most`
    they count as these.

    Square roots: of albedos as displays encode them, of alpha as Blender's roughness is.
    """
    return states.clamp(least, most).sqrt()
