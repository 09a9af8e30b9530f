"""How an encoder does on seen and unseen materials while it is trained."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.representation.latents import Representation

from .data.nbrdf import HELD_OUT, NeuralBRDFs, load
from .metric.sphere import Sphere, psnr

__all__ = ("Progress",)

_PIXELS = 12
_SAMPLES = 1024
_SEEN = 20


@dataclass(frozen=True)
class Progress:
    """Small lit spheres of MERL seen (every fourth material), MERL held out and RGL.

    `sets`: name to (materials, their rendered truth [n, E, P, 3]). Coarser than the metric of
    docs/design.md, and quick enough to be looked at twenty times in a run.
    """

    sphere: Sphere
    sets: dict[str, tuple[NeuralBRDFs, Tensor]]

    @classmethod
    def load(cls, data: Path) -> Progress:
        """Render the truth from the networks and environment maps in the data folder."""
        sphere = Sphere.load(data / "hdri", pixels=_PIXELS)
        merl = load(data, "merl")
        seen = merl.without(HELD_OUT)
        networks = {
            "merl_seen": seen.select(list(seen.names[:: len(seen) // _SEEN])),
            "merl_held_out": merl.select(list(HELD_OUT)),
            "rgl": load(data, "rgl-isotropic").without(("chm_orange_rgb",)),
        }
        return cls(
            sphere,
            {
                name: (some, sphere.render(lambda angles, some=some: _all(some, angles), chunk=8))
                for name, some in networks.items()
            },
        )

    @torch.no_grad()
    def scores(self, model: Representation) -> dict[str, float]:
        """Mean PSNR in dB of each set."""
        angles = model.sample_angles(_SAMPLES, measured=True)
        result = {}
        for name, (networks, truth) in self.sets.items():
            latents = model.encode(angles, _all(networks, angles))
            shown = self.sphere.render(
                lambda wanted, latents=latents: model.decode(latents, wanted), chunk=8
            )
            result[name] = round(float(psnr(truth, shown).mean()), 2)
        return result


def _all(networks: NeuralBRDFs, angles: Tensor) -> Tensor:
    return networks.evaluate(torch.arange(len(networks)), angles)
