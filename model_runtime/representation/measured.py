"""Measured BRDFs as latents that were looked at again.

An encoder is trained on what its training has seen: a material unlike all of that may come back as
another one. What the decoder makes of its latents is therefore compared with the measurement from
sides that nobody has read, and where it is off the latents are brought closer through the decoder,
from what the encoder says and from what a Torrance-Sparrow fit says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..brdf.fit import fit_angles, fit_torrance_sparrow
from ..brdf.refinement import WELL_HELD, Measurements
from ..brdf.views import other_views
from .latents import PAPER_SAMPLES, Latents, Representation

__all__ = ("Encoded", "encode_measured")


@dataclass(frozen=True)
class Encoded:
    """Latents of N measured BRDFs, and how near they look when decoded, in dB [N]."""

    latents: Latents
    db: Tensor


def encode_measured(
    representation: Representation, evaluate: Callable[[Tensor], Tensor]
) -> Encoded:
    """Latents of N BRDFs `evaluate`(angles [M, 3]) -> f [N, M, 3], checked and, where they look off
    refined by a fixed number of steps.
    """
    asked = representation.sample_angles(PAPER_SAMPLES, measured=True)
    latents = representation.encode(asked, evaluate(asked))
    measured = Measurements.of(evaluate)
    flat, angles = latents.flat(), other_views().angles
    db = measured.psnr(representation.decode(latents, angles))
    off = (db < WELL_HELD).nonzero()[:, 0]
    if not len(off):
        return Encoded(latents, db)
    fitted = fit_torrance_sparrow(evaluate(fit_angles())[off]).parameters()
    starts = torch.cat((flat[off], representation.encode_parameters(fitted).flat()))
    some = measured[off.repeat(2)]
    found = some.nearest(starts, lambda z, a: representation.decode(latents.unflat(z), a))
    nearer = some.psnr(representation.decode(latents.unflat(found), angles))
    every = torch.stack((db[off], *nearer.split(len(off))))
    chosen = every.argmax(0)
    flat, db = flat.clone(), db.clone()
    db[off] = every.amax(0)
    flat[off] = torch.stack((flat[off], *found.split(len(off))))[chosen, torch.arange(len(off))]
    return Encoded(latents.unflat(flat), db)
