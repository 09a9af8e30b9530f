"""What further lobes of a measured material cost and gain."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from model_runtime.brdf import lobes, rgl
from model_runtime.brdf.lobes import LobedFit, fit_lobes, one_more
from model_runtime.brdf.refinement import Measurements, fit_seen
from model_runtime.channels import MOST_LOBES
from model_runtime.contract import AgeRequest

from ...data.nbrdf import load
from ...metric.sphere import Sphere, psnr

__all__ = ("WORST", "lobe_rows")

WORST = (
    *("cc_blue_agat_rgb", "cc_green_malachite_rgb", "ilm_solo_m_68_rgb"),
    *("cc_iris_purple_gem_rgb", "ilm_l3_37_dark_green_rgb"),
)
"""The five of RGL's materials that one lobe shows worst (`evaluate representation --methods
one_lobe`), but for the bad fit."""

Values = Callable[[Tensor], Tensor]


@torch.inference_mode()
def lobe_rows(data: Path, *, pixels: int) -> list[dict[str, Any]]:
    """The `.bsdf` files of `data` and `WORST`, each by one lobe, two and three: `material`,
    `lobes`, seconds of a `core` until that fit is found, dB on spheres `pixels` wide (`psnr`), and
    whether `age` would take so many (`chosen`).
    """
    sphere = Sphere.load(data / "hdri", pixels=pixels)
    return [
        {"material": name, **row}
        for name, values in _materials(data)
        for row in _rows(values, sphere)
    ]


def _materials(data: Path) -> Iterator[tuple[str, Values]]:
    """Names, and angles [M, 3] -> f [1, M, 3]."""
    for path in sorted((data / "bsdf").glob("*.bsdf")):
        brdf = rgl.read(path)
        yield path.name, lambda angles, brdf=brdf: brdf.evaluate(angles)[None]
    for name in WORST:
        network = load(data, "rgl-isotropic").select([name])
        yield name, lambda angles, network=network: network.evaluate(torch.arange(1), angles)


def _rows(values: Values, sphere: Sphere) -> list[dict[str, Any]]:
    truth = sphere.render(values)
    clock = time.process_time()
    measured, fits = Measurements.of(values), [LobedFit.of(fit_seen(values))]
    seconds = [time.process_time() - clock]
    while len(fits) < MOST_LOBES:
        fits.append(one_more(measured, fits[-1]))
        seconds.append(time.process_time() - clock)
    chosen = fit_lobes(measured, fits[0], AgeRequest.tolerance).lobes

    def shown(fit: LobedFit) -> float:
        looks = sphere.render(lambda angles: lobes.evaluate(fit.lobed, angles))
        return float(psnr(truth, looks).mean())

    return [
        {
            "lobes": fit.lobes,
            "core": round(spent, 3),
            "psnr": round(shown(fit), 2),
            "chosen": fit.lobes == chosen,
        }
        for fit, spent in zip(fits, seconds, strict=True)
    ]
