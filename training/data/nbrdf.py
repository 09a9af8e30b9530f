"""Measured BRDFs as the small networks of Neural-BRDF (Sztrajman et al. 2021), many at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from model_runtime.brdf.half_angle import cosines
from model_runtime.errors import InputError, reason, shown

__all__ = ("HELD_OUT", "NeuralBRDFs", "load")

HELD_OUT = ("alum-bronze", "blue-acrylic", "dark-red-paint", "pink-felt", "steel")
"""MERL materials that no bundled model is trained on: two metals, a plastic, a paint, a cloth."""

MEASURED_MAX = 5000.0


@dataclass(frozen=True)
class NeuralBRDFs:
    """`names` [n] and the stacked weights of n networks 6 -> 21 -> 21 -> 3 (data/README.md)."""

    names: tuple[str, ...]
    layers: tuple[tuple[Tensor, Tensor], ...]

    def __len__(self) -> int:
        return len(self.names)

    def select(self, names: list[str]) -> NeuralBRDFs:
        """The networks of `names`, in that order."""
        rows = torch.tensor([self.names.index(name) for name in names])
        return NeuralBRDFs(tuple(names), tuple((w[rows], b[rows]) for w, b in self.layers))

    def to(self, device: torch.device) -> NeuralBRDFs:
        """The same on another device."""
        return replace(self, layers=tuple((w.to(device), b.to(device)) for w, b in self.layers))

    def without(self, names: tuple[str, ...]) -> NeuralBRDFs:
        """All networks but those of `names`."""
        return self.select([name for name in self.names if name not in names])

    def evaluate(self, rows: Tensor, angles: Tensor) -> Tensor:
        """f per steradian of networks `rows` [N] at `angles` [M, 3] or [N, M, 3]: [N, M, 3].

        The networks are only roughly reciprocal; the mean over both directions of light is
        returned, 0 below the horizon, and at most 5,000.
        """
        angles = angles.expand(len(rows), *angles.shape[-2:])
        theta_h, theta_d, phi_d = angles.unbind(-1)
        sin_d = theta_d.sin()
        across, along = sin_d * phi_d.cos(), sin_d * phi_d.sin()
        fixed = (theta_h.sin(), torch.zeros_like(theta_h), theta_h.cos())
        forth = torch.stack((*fixed, across, along, theta_d.cos()), -1)
        back = torch.stack((*fixed, -across, -along, theta_d.cos()), -1)
        x = torch.cat((forth, back), 1)
        for i, (weight, bias) in enumerate(self.layers):
            x = torch.baddbmm(bias[rows, None], x, weight[rows])
            if i < 2:
                x = x.relu()
        x = torch.expm1(x.clamp(max=10)).clamp(0, MEASURED_MAX)
        mean = x.unflatten(1, (2, -1)).mean(1)
        cos_i, cos_o, _, _ = cosines(angles)
        return mean * ((cos_i > 0) & (cos_o > 0))[..., None]


def load(data: Path, database: str) -> NeuralBRDFs:
    """The networks of `database` ("merl" or "rgl-isotropic") in the data folder. Raises InputError
    where they are missing or damaged.
    """
    path = data / "nbrdf" / f"{database}_nbrdf.npz"
    try:
        with np.load(path, allow_pickle=False) as stored:
            layers = tuple(
                (torch.from_numpy(stored[f"fc{i}"]), torch.from_numpy(stored[f"b{i}"]))
                for i in (1, 2, 3)
            )
            return NeuralBRDFs(tuple(str(name) for name in stored["names"]), layers)
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise InputError(
            f"{shown(path)} cannot be read: {reason(error)}.", "Copy the data folder again."
        ) from error
