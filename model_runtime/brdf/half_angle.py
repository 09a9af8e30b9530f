"""Half-angle coordinates of isotropic BRDFs (Rusinkiewicz, EGSRT 1998).

`angles` are tensors [..., 3] holding (theta_h, theta_d, phi_d) in radians; phi_h is 0. Directions
are unit vectors [..., 3] in the local frame whose +z is the surface normal.
"""

from __future__ import annotations

import math

from ..backend import Tensor, functional, torch

__all__ = (
    "above_horizon",
    "cosines",
    "directions",
    "from_directions",
    "network_input",
)


def directions(angles: Tensor) -> tuple[Tensor, Tensor]:
    """Incoming and outgoing unit vectors, each [..., 3], of `angles` [..., 3].

    The difference vector d = (sin td cos pd, sin td sin pd, cos td) is tilted by theta_h about the
    y axis to give wi; wo is wi mirrored about the half vector. Either may lie below the horizon.
    """
    theta_h, theta_d, phi_d = angles.unbind(-1)
    sin_h, cos_h = theta_h.sin(), theta_h.cos()
    sin_d, cos_d = theta_d.sin(), theta_d.cos()
    along_x, along_y = sin_d * phi_d.cos(), sin_d * phi_d.sin()
    wi = torch.stack(
        (along_x * cos_h + cos_d * sin_h, along_y, cos_d * cos_h - along_x * sin_h), -1
    )
    wo = torch.stack(
        (cos_d * sin_h - along_x * cos_h, -along_y, cos_d * cos_h + along_x * sin_h), -1
    )
    return wi, wo


def from_directions(wi: Tensor, wo: Tensor) -> Tensor:
    """Half-angle coordinates [..., 3] of unit vectors `wi`, `wo` [..., 3]; phi_d in (-pi, pi].

    Directions that are exactly opposite have no half vector; theta_h is then 0.
    """
    half = functional.normalize(wi + wo, dim=-1)
    sin_h = torch.hypot(half[..., 0], half[..., 1])
    theta_h = torch.atan2(sin_h, half[..., 2])
    safe = sin_h.clamp_min(torch.finfo(wi.dtype).tiny)
    cos_phi = torch.where(sin_h > 0, half[..., 0] / safe, torch.ones_like(sin_h))
    sin_phi = torch.where(sin_h > 0, half[..., 1] / safe, torch.zeros_like(sin_h))
    turned_x = wi[..., 0] * cos_phi + wi[..., 1] * sin_phi
    along_y = wi[..., 1] * cos_phi - wi[..., 0] * sin_phi
    along_x = turned_x * half[..., 2] - wi[..., 2] * sin_h
    cos_d = turned_x * sin_h + wi[..., 2] * half[..., 2]
    theta_d = torch.atan2(torch.hypot(along_x, along_y), cos_d)
    return torch.stack((theta_h, theta_d, torch.atan2(along_y, along_x)), -1)


def cosines(angles: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(cos_i, cos_o, cos_h, cos_d), each [...]: wi.n, wo.n, h.n and wi.h."""
    theta_h, theta_d, phi_d = angles.unbind(-1)
    cos_h, cos_d = theta_h.cos(), theta_d.cos()
    common, apart = cos_d * cos_h, theta_d.sin() * phi_d.cos() * theta_h.sin()
    return common - apart, common + apart, cos_h, cos_d


def above_horizon(angles: Tensor, *, margin: float = 0.0) -> Tensor:
    """Boolean [...]: both directions have a cosine above `margin`."""
    cos_i, cos_o, _, _ = cosines(angles)
    return (cos_i > margin) & (cos_o > margin)


def network_input(angles: Tensor) -> Tensor:
    """[..., 4] = (theta_h, theta_d, sin 2 phi_d, cos 2 phi_d), scaled to the order of 1.

    Doubling phi_d makes the coordinates, and so every network of them, reciprocal.
    """
    theta_h, theta_d, phi_d = angles.unbind(-1)
    return torch.stack(
        (
            theta_h * (2 / math.pi),
            theta_d * (2 / math.pi),
            (2 * phi_d).sin(),
            (2 * phi_d).cos(),
        ),
        -1,
    )
