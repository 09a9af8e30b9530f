"""What a representation promises beside accuracy, measured: `measure_properties`."""

from __future__ import annotations

import copy
import itertools
import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from model_runtime.brdf.half_angle import from_directions
from model_runtime.representation.latents import Latents

from ...baselines.encoders import Encoder
from ...data.analytic import random_torrance_sparrow
from ...metric.albedo import INCIDENCES, Albedos
from ...metric.sphere import Sphere, psnr, tone_map
from .damages import measure_stability
from .probes import SEED, Group, analytic_groups, measured_groups, reflecting, together

__all__ = (
    "agreement",
    "color_permutation",
    "energy",
    "everywhere",
    "measure_properties",
    "neighborhood",
    "range_of_values",
    "reciprocity",
    "short_cut",
)

_FEW = 258
"""Directions read where only equality is asked for."""

_BLACK = 0.01
"""Reflectance (1/sr) of a near-black diffuse: differences of less are compared with it, as the
value itself may be 0."""


def _relative(one: Tensor, other: Tensor, floor: float = _BLACK) -> float:
    """Largest |one - other| over the larger of both and of `floor`."""
    scale = torch.maximum(one.abs(), other.abs()).clamp_min(floor)
    return float(((one - other).abs() / scale).max())


def _displaced(one: Tensor, other: Tensor) -> float:
    """Largest |one - other| over the root mean square of `one`; 0 where there are no latents."""
    if one.numel() == 0:
        return 0.0
    return float((one - other).abs().max() / one.square().mean().sqrt())


def _directions(n: int) -> tuple[Tensor, Tensor]:
    """Seeded pairs [2 n, 3] of unit vectors above the horizon, float64: n all over, a tenth of them
    within a degree of grazing, and n within 0.1 rad of a mirror reflection.
    """
    g = torch.Generator().manual_seed(SEED)
    u = torch.rand(4, n, 2, generator=g, dtype=torch.float64)
    cos = u[:, :, 0]
    cos[:, : n // 10] *= 0.017
    phi = u[:, :, 1] * 2 * math.pi
    sin = (1 - cos.square()).sqrt()
    wi, wo, near, spread = torch.stack((sin * phi.cos(), sin * phi.sin(), cos), -1)
    mirror = near * torch.tensor((-1.0, -1.0, 1.0)) + 0.1 * spread * u[3, :, :1] ** 4
    mirror = torch.nn.functional.normalize(mirror, dim=-1)
    return torch.cat((wi, near)), torch.cat((wo, mirror))


def everywhere() -> Tensor:
    """Angles [M, 3] from exact mirror peaks out to 89.9 degrees, for light and eye."""
    theta = torch.tensor((0.0, 1.0, 20.0, 45.0, 70.0, 85.0, 89.0, 89.9)).double().deg2rad()
    off = torch.tensor((0.0, 1e-6, 1e-4, 1e-3, 0.01, 0.1)).double()
    turn = torch.linspace(0, math.pi, 13).double()

    def unit(polar: Tensor, azimuth: Tensor) -> Tensor:
        sin = polar.sin()
        return torch.stack((sin * azimuth.cos(), sin * azimuth.sin(), polar.cos()), -1)

    one, other, phi = torch.cartesian_prod(theta, theta, turn).T
    wi, wo = unit(one, 0 * one), unit(other, phi)
    one, tilt, side = torch.cartesian_prod(theta, off, torch.tensor((-1.0, 1.0)).double()).T
    eye = (one + side * tilt).clamp(0, math.radians(89.9))
    wi = torch.cat((wi, unit(one, 0 * one)))
    wo = torch.cat((wo, unit(eye, torch.full_like(one, math.pi))))
    return from_directions(wi, wo).float()


def _double(model: Encoder) -> Encoder:
    return copy.deepcopy(model).double()


def color_permutation(model: Encoder, group: Group) -> dict[str, float]:
    """Largest changes over all six orders of the channels: of shared and of color latents (put
    back in order), over their root mean square, and of the decoded BRDF, relative.

    In single precision, and (`exact`, decoded only) in double, which tells rounding from the rest.
    """
    wi, wo = _directions(300)
    report = {}
    for kind, net in (("", model), ("exact_", _double(model))):
        dtype = next(net.parameters()).dtype
        angles = net.sample_angles(_FEW).to(dtype)
        seen = group.evaluate(angles.float()).to(dtype)
        wanted = from_directions(wi, wo).to(dtype)
        plain = net.encode(angles, seen)
        f = net.decode(plain, wanted)
        worst = {"shared": 0.0, "color": 0.0, "decoded": 0.0}
        for order in itertools.permutations(range(3)):
            back = [order.index(channel) for channel in range(3)]
            other = net.encode(angles, seen[..., list(order)])
            now = {
                "shared": _displaced(plain.shared, other.shared),
                "color": _displaced(plain.color, other.color[:, back]),
                "decoded": _relative(f, net.decode(other, wanted)[..., back]),
            }
            worst = {key: max(value, now[key]) for key, value in worst.items()}
        report |= {f"{kind}{key}": value for key, value in worst.items()}
    return report


def reciprocity(model: Encoder, group: Group) -> dict[str, float]:
    """Largest relative |f(i, o) - f(o, i)| of what is decoded, in single and double precision."""
    latents = group.encoded(model)
    wi, wo = _directions(1000)
    forth, back = from_directions(wi, wo), from_directions(wo, wi)
    double = Latents(latents.color.double(), latents.shared.double())
    precise = _double(model)
    return {
        "single": _relative(
            model.decode(latents, forth.float()), model.decode(latents, back.float())
        ),
        "exact": _relative(precise.decode(double, forth), precise.decode(double, back)),
    }


def range_of_values(model: Encoder, group: Group) -> dict[str, Any]:
    """Least and largest decoded value from mirror peaks to grazing, and whether all are finite."""
    f = model.decode(group.encoded(model), everywhere())
    finite = f.isfinite()
    return {
        "finite": bool(finite.all()),
        "min": float(f[finite].min()),
        "max": float(f[finite].max()),
        "directions": len(everywhere()),
    }


def energy(model: Encoder, group: Group) -> dict[str, Any]:
    """Albedos of the decoded BRDFs against those of the input.

    `excess` and `diffuse_excess`: the largest decoded minus input, directional and bihemispherical,
    in shares of the incident light; `*_relative`: over the input's albedo, where that is above 1 %.
    `mean`: over everything, signed. `at`: material and incidence of the largest.
    """
    latents = group.encoded(model)
    truth = Albedos.of(group.evaluate)
    ours = Albedos.of(lambda angles: model.decode(latents, angles))
    excess = ours.directional - truth.directional
    worst = excess.amax(2)
    row, incidence = divmod(int(worst.argmax()), len(INCIDENCES))

    def relative(decoded: Tensor, given: Tensor) -> float:
        seen = given > 0.01
        return float((decoded / given - 1)[seen].max()) if seen.any() else 0.0

    return {
        "excess": float(worst.max()),
        "excess_relative": relative(ours.directional, truth.directional),
        "diffuse_excess": float((ours.diffuse - truth.diffuse).max()),
        "diffuse_excess_relative": relative(ours.diffuse, truth.diffuse),
        "mean": float(excess.mean()),
        "over_two_percent": float((excess > 0.02).float().mean()),
        "at": f"{group.names[row]}, {INCIDENCES[incidence]:g} degrees",
        "by_incidence": dict(
            zip((f"{i:g}" for i in INCIDENCES), excess.amax((0, 2)).tolist(), strict=True)
        ),
    }


def agreement(model: Encoder, group: Group) -> dict[str, float]:
    """Largest relative differences of latents and decoded values between batches of 1, 7 and 64,
    and between one and two threads.
    """
    angles = model.sample_angles(_FEW)
    seen = group.evaluate(angles)
    seen = seen.repeat(-(-64 // len(seen)), 1, 1)[:64]
    wanted = from_directions(*_directions(50)).float()
    threads = torch.get_num_threads()

    def run(batch: int, workers: int) -> tuple[Tensor, Tensor]:
        torch.set_num_threads(workers)
        flat, f = [], []
        for part in seen.split(batch):
            latents = model.encode(angles, part)
            flat.append(latents.flat())
            f.append(model.decode(latents, wanted))
        return torch.cat(flat), torch.cat(f)

    try:
        first, *others = (run(b, w) for b, w in ((64, 1), (64, 2), (7, 1), (1, 1)))
    finally:
        torch.set_num_threads(threads)
    return {
        "latents": max(_displaced(first[0], other[0]) for other in others),
        "decoded": max(_relative(first[1], other[1]) for other in others),
    }


def neighborhood(model: Encoder, sphere: Sphere, n: int = 40) -> dict[str, float]:
    """Spearman's rank correlation, over all pairs of `n` random Torrance-Sparrow materials, of the
    distance of their latents and the root mean square difference of their tone-mapped spheres.
    """
    states = random_torrance_sparrow(n, torch.Generator().manual_seed(SEED + 1))
    group = reflecting((), *states)
    shown = tone_map(sphere.render(group.evaluate, chunk=4)).flatten(1)
    apart = torch.pdist(group.encoded(model).flat())
    ranks = torch.stack((apart, torch.pdist(shown))).argsort(1).argsort(1).double()
    return {"rank_correlation": float(torch.corrcoef(ranks)[0, 1]), "pairs": len(apart)}


def short_cut(model: Encoder, sphere: Sphere, n: int = 40) -> dict[str, float]:
    """Torrance-Sparrow materials encoded from their parameters, and from samples: PSNR in dB of
    either, mean and worst of `n`, against the truth.
    """
    states = random_torrance_sparrow(n, torch.Generator().manual_seed(SEED + 3))
    kd, ks, alpha = states
    group = reflecting(("",) * n, *states)
    truth = sphere.render(group.evaluate, chunk=4)
    report = {}
    for name, latents in (
        ("sampled", group.encoded(model)),
        ("short", model.encode_parameters(torch.cat((kd, ks, alpha[:, None]), 1))),
    ):
        shown = sphere.render(lambda angles, z=latents: model.decode(z, angles), chunk=4)
        scores = psnr(truth, shown).mean(1)
        report |= {name: float(scores.mean()), f"{name}_min": float(scores.min())}
    return report


@torch.no_grad()
def measure_properties(model: Encoder, data: Path, *, pixels: int = 16) -> dict[str, Any]:
    """Every property of `model` on the same materials: numbers, ready for JSON.

    Spheres are `pixels` wide under maps of 32 x 16 directions. `energy` is by set, `stability` by
    damage (see `damages.measure_stability`).
    """
    groups = measured_groups(data) | analytic_groups()
    everything = together(groups)
    sphere = Sphere.load(data / "hdri", pixels=pixels, height=16, width=32)
    return {
        "color_permutation": color_permutation(model, everything),
        "reciprocity": reciprocity(model, everything),
        "range": range_of_values(model, everything),
        "energy": {name: energy(model, group) for name, group in groups.items()},
        "agreement": agreement(model, everything),
        "neighborhood": neighborhood(model, sphere),
        "short_cut": short_cut(model, sphere),
        "stability": measure_stability(model, data, sphere),
    }
