"""Stresses of measured input: materials ever less like any that an encoder was trained on.

Nothing is continued here: what is scored is how a measured material comes back in the first frame,
as maps (ours: the product's own, as it writes them by default) or as latents.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.brdf import merl, torrance_sparrow
from model_runtime.brdf.half_angle import above_horizon, cosines
from model_runtime.brdf.lobes import evaluate
from model_runtime.brdf.measured import MeasuredBRDF
from model_runtime.channels import lobe_maps
from model_runtime.contract import EVERYWHERE, TORRANCE_SPARROW, AgeRequest, frame_file
from model_runtime.images import read_image
from model_runtime.representation import Trained
from model_runtime.representation.measured import encode_measured

from ...metric.sphere import Sphere, psnr
from ..bench.aging import age_silently
from .product import read_states
from .trials import Stress, Trial, TrialSetup

__all__ = ("MEASURED", "held_as_latents", "held_by_the_product", "iridescent")

_ALBEDO, _FLAKES, _SHINE = 0.03, 0.6, 0.04
_TURN = 9.0  # radians that the hue turns by from a grazing to a steep look at a flake
_SPREAD = 0.06  # 1 - cosine of flakes about the normal
_GLOSS = 0.02
_PAPER_SAMPLES = 1024  # directions, as in `evaluate representation`


def iridescent(share: float) -> MeasuredBRDF:
    """A paint under a clear coat whose flakes change their hue as light and eye part; `share`, 0 to
    1, of what they reflect does.
    """

    def evaluate(angles: Tensor) -> Tensor:
        _, _, cos_h, cos_d = cosines(angles)
        phase = _TURN * cos_d[:, None] + angles.new_tensor((0.0, 2.1, 4.2))
        hue = (1 - share) * 0.5 + share * 0.5 * (1 + phase.cos())
        flakes = _FLAKES * hue * torch.exp(-(1 - cos_h) / _SPREAD)[:, None]
        alpha = angles.new_tensor((_GLOSS,))
        shine = torrance_sparrow.specular_lobe(alpha, angles)[0, :, None]
        return _ALBEDO / torch.pi + flakes + _SHINE * shine

    return MeasuredBRDF(f"iridescent {share:g}", evaluate)


def held_as_latents(
    brdf: MeasuredBRDF, representation: Trained, sphere: Sphere, *, refined: bool
) -> float:
    """PSNR in dB of what an encoder, or one whose latents are looked at again, makes of it."""

    def values(angles: Tensor) -> Tensor:
        return brdf.evaluate(angles)[None]

    with torch.no_grad():
        if refined:
            latents = encode_measured(representation, values).latents
        else:
            angles = representation.sample_angles(_PAPER_SAMPLES, measured=True)
            latents = representation.encode(angles, values(angles))
        shown = sphere.render(lambda angles: representation.decode(latents, angles))
    return float(psnr(sphere.render(values), shown).mean())


def held_by_the_product(
    brdf: MeasuredBRDF, ntm: Path, sphere: Sphere
) -> tuple[float, tuple[str, ...]]:
    """Likewise of the first frame that `age` writes of a MERL file of it, with the model `ntm`; and
    what it says.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "measured.binary", Path(folder) / "aged"
        merl.write(source, _table(brdf))
        request = AgeRequest(
            source, str(ntm), output, frames=2, onset=EVERYWHERE, format=TORRANCE_SPARROW
        )
        told = age_silently(request)
        further = (
            read_image(_first_frame(output, name), color=channels > 1).reshape(1, channels)
            for name, channels in lobe_maps([True] * (told["lobes"] - 1)).items()
        )
        lobed = torch.cat((read_states(output, 1), *map(torch.from_numpy, further)), 1)
    truth = sphere.render(lambda angles: brdf.evaluate(angles)[None])
    shown = sphere.render(lambda angles: evaluate(lobed, angles))
    return float(psnr(truth, shown).mean()), tuple(told["warnings"])


def _first_frame(folder: Path, name: str) -> Path:
    """The file of a lobe's map; that of its color where its edge has none of its own."""
    file = folder / frame_file(name, 0)
    return file if file.exists() else folder / frame_file(name.replace("edge", "color"), 0)


def _table(brdf: MeasuredBRDF) -> NDArray[np.float64]:
    """On MERL's grid."""
    grid = merl.grid_angles().reshape(-1, 3)
    f = torch.where(above_horizon(grid)[:, None], brdf.evaluate(grid), -1)
    return f.reshape(*merl.GRID, 3).numpy()


def _measured(setup: TrialSetup, share: float) -> Trial:
    return Trial(setup.case(), measured=iridescent(share))


MEASURED: Mapping[str, Stress] = {
    "iridescence": Stress(
        "measured paint, ever more iridescent",
        "share of its flakes' light that changes hue",
        (0.0, 0.5, 1.0),
        _measured,
        methods=("ours", "paper", "lstm_latents"),
        note="what is scored is the first frame, as maps (ours, as all methods on parameters) or as"
        " latents",
    ),
}
"""By name."""
