"""Further lobes: their formula, and that they are only added where they show."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from model_runtime.brdf import lobes
from model_runtime.brdf.half_angle import above_horizon, directions
from model_runtime.brdf.lobes import LobedFit, fit_lobes, following, one_more
from model_runtime.brdf.refinement import Measurements, fit_seen
from model_runtime.brdf.views import views
from model_runtime.channels import (
    FURTHER,
    MOST_LOBES,
    WIDTH,
    lobe_maps,
    lobe_planes,
    turning,
    turning_in,
)
from training.data.nbrdf import load
from training.metric.sphere import Sphere, psnr

pytestmark = pytest.mark.usefixtures("one_thread")

PAINT = torch.tensor(
    (
        (0.2, 0.1, 0.05, 0.03, 0.03, 0.03, 0.1, 0.05, 0.02, 0.0, 0.05, 0.02, 0.0, 0.6, 0.4),
        (0.02, 0.05, 0.1, 0.3, 0.2, 0.1, 0.5, 0.04, 0.04, 0.04, 0.04, 0.04, 0.04, 1.0, 0.05),
        (0.02, 0.02, 0.02, 0.03, 0.03, 0.03, 0.02, 0.1, 0.3, 0.02, 0.4, 0.05, 0.3, 0.6, 0.3),
    )
)
"""Three materials of two lobes; the last one turns from green to violet."""


def painted(angles: Tensor) -> Tensor:
    return lobes.evaluate(PAINT, angles)


def by_hand(lobe: np.ndarray, angles: Tensor) -> np.ndarray:
    """A further lobe [8] as Cycles has it, f [M, 3] in double precision: a base color mixed by
    Facing, Schlick's Fresnel term, GGX, and Smith's masking by heights that correlate,
    1 / (1 + Lambda_i + Lambda_o).
    """
    wi, wo = (w.numpy() for w in directions(angles.double()))
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    color, edge, weight, alpha = lobe[:3], lobe[3:6], lobe[6], lobe[7]
    facing = 1 - wo[:, 2:]
    base = (1 - facing) * color + facing * edge
    tan2_h = 1 / half[:, 2] ** 2 - 1
    d = 1 / (math.pi * alpha**2 * half[:, 2] ** 4 * (1 + tan2_h / alpha**2) ** 2)
    lambdas = [(np.sqrt(1 + alpha**2 * (1 / w[:, 2] ** 2 - 1)) - 1) / 2 for w in (wi, wo)]
    rho = d / (1 + sum(lambdas)) / (4 * wi[:, 2] * wo[:, 2])
    schlick = (1 - (wi * half).sum(1)) ** 5
    return weight * (base + (1 - base) * schlick[:, None]) * rho[:, None]


def test_the_formula_is_that_of_cycles():
    angles = torch.rand(400, 3, generator=torch.Generator().manual_seed(1)) * torch.tensor(
        (1.5, 1.5, math.pi)
    )
    angles = angles[above_horizon(angles, margin=0.02)]
    assert len(angles) > 100
    both = lobes.evaluate(PAINT.double(), angles.double())
    one = lobes.evaluate(PAINT[:, :WIDTH].double(), angles.double())
    for row, further in zip((both - one).numpy(), PAINT[:, WIDTH:].double().numpy(), strict=True):
        np.testing.assert_allclose(row, by_hand(further, angles), rtol=1e-5, atol=1e-9)


@cache
def fits() -> tuple[LobedFit, LobedFit]:
    """The three materials by one lobe, and by two."""
    one = LobedFit.of(fit_seen(painted))
    return one, one_more(Measurements.of(painted), one)


def test_what_two_lobes_hold_they_find():
    one, two = fits()
    assert one.lobes == 1 and two.lobes == 2
    assert float(one.db.max()) < 40
    assert float(two.db.min()) > 44


def test_a_color_turns_only_where_that_shows():
    two = fits()[1].further[:, 0]
    assert turning(two).tolist() == [False, False, True]
    assert torch.equal(two[:2, :3], two[:2, 3:6])
    torch.testing.assert_close(two[2, :6], PAINT[2, WIDTH:][:6], rtol=0.15, atol=0.03)


def test_one_lobe_that_suffices_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch):
    """And costs nothing."""

    def plain(angles: Tensor) -> Tensor:
        return lobes.evaluate(PAINT[:1, :WIDTH], angles)

    one = LobedFit.of(fit_seen(plain))
    monkeypatch.setattr(lobes, "one_more", None)
    assert fit_lobes(Measurements.of(plain), one, 45.0) is one


def test_the_fewest_that_reach_the_tolerance_are_taken():
    measured = Measurements.of(painted)[torch.tensor([0])]
    seen = fit_seen(lambda angles: painted(angles)[:1])
    one = LobedFit.of(seen)
    found = [fit_lobes(measured, one, tolerance) for tolerance in (float(one.db) - 1, 40.0, 100.0)]
    assert [fit.lobes for fit in found[:2]] == [1, 2]
    assert found[2].lobes <= MOST_LOBES
    assert float(found[2].db) >= float(found[1].db) > 40


def test_of_what_no_lobe_shows_none_is_added():
    """Light that comes back to where it came from."""

    def retro(angles: Tensor) -> Tensor:
        back = torch.exp(-(angles[:, 1] - math.pi / 2).square() / 0.1)
        return (0.05 + 0.2 * back)[None, :, None].expand(1, -1, 3)

    one = LobedFit.of(fit_seen(retro))
    measured = Measurements.of(retro)
    most = fit_lobes(measured, one, 100.0)
    assert float(most.db) >= float(one.db)
    if most.lobes > 1:
        assert float(most.db) >= float(one.db) + 0.5


@pytest.mark.parametrize("specular", ["rgb", "mono"])
def test_they_stay_in_range_whatever_is_missing(data_folder: Path, specular):
    nets = load(data_folder, "rgl-isotropic").select(["paper_green_rgb"])

    def evaluate(angles: Tensor) -> Tensor:
        f = nets.evaluate(torch.arange(1), angles)
        return f.masked_fill((torch.arange(f.shape[1]) % 7 == 0)[:, None], math.nan)

    fit = one_more(Measurements.of(evaluate), LobedFit.of(fit_seen(evaluate, specular)), specular)
    ends, weight, alpha = fit.further[..., :6], fit.further[..., 6], fit.further[..., 7]
    assert fit.lobed.shape == (1, WIDTH + FURTHER)
    assert bool(fit.lobed.isfinite().all()) and float(fit.lobed.min()) >= 0
    assert float(ends.max()) <= 1 and 0 < float(weight.max()) <= 1
    assert 1e-4 <= float(alpha.min()) <= float(alpha.max()) <= 1
    if specular == "mono":
        for color in ends.split(3, -1):
            assert float(color.amax() - color.amin()) == 0


def test_a_measured_paint_gains_what_one_lobe_cannot_show(data_folder: Path):
    """On the metric's spheres: Fresnel, which flat lobes lack."""
    nets = load(data_folder, "rgl-isotropic").select(["cm_military_green_rgb", "paper_green_rgb"])

    def evaluate(angles: Tensor) -> Tensor:
        return nets.evaluate(torch.arange(2), angles)

    sphere = Sphere.load(data_folder / "hdri", pixels=10)
    truth = sphere.render(evaluate)

    def reached(fit: LobedFit) -> Tensor:
        return psnr(truth, sphere.render(lambda a: lobes.evaluate(fit.lobed, a))).mean(1)

    one = LobedFit.of(fit_seen(evaluate))
    two = one_more(Measurements.of(evaluate), one)
    assert bool((reached(two) > reached(one) + 5).all())


def test_each_is_fitted_as_if_it_were_alone():
    both = fits()[1]

    def second(angles: Tensor) -> Tensor:
        return painted(angles)[1:2]

    alone = one_more(Measurements.of(second), LobedFit.of(fit_seen(second)))
    torch.testing.assert_close(both.db[1:2], alone.db, rtol=0, atol=0.5)


@pytest.mark.parametrize(
    ("row", "last"),
    [
        (0, (0.02, 0.01, 0.0, 0.02, 0.01, 0.0, 0.2, 0.6)),
        (2, (0.02, 0.1, 0.1, 0.1, 0.1, 0.1, 0.3, 0.5)),
    ],
)
def test_lobes_that_follow_a_change_stay_the_same_ones(row, last):
    """A lobe that fades and widens evenly does so in the fit; one of one color keeps to one."""
    share = torch.linspace(0, 1, 9)
    start = PAINT[row : row + 1]
    end = start.clone()
    end[:, WIDTH:] = torch.tensor(last)
    truth = start + share[:, None] * (end - start)
    read = lobes.evaluate(truth, views().angles)
    found = following(start, lambda step: read[step : step + 1], len(share), "rgb")[0]
    assert found.shape == truth.shape
    torch.testing.assert_close(found, truth, rtol=0.1, atol=0.02)
    steps = found.diff(dim=0)
    assert float(steps.diff(dim=0).abs().max()) < 0.03
    if row == 0:
        assert torch.equal(found[:, WIDTH:][:, :3], found[:, WIDTH:][:, 3:6])


def test_of_one_color_there_is_no_map_of_an_edge():
    further = PAINT[[0, 2], WIDTH:]
    turns = turning(further).tolist()
    assert turns == [False, True]
    maps = lobe_maps(turns)
    assert list(maps) == [
        *("second_color", "second_weight", "second_alpha"),
        *("third_color", "third_edge", "third_weight", "third_alpha"),
    ]
    planes = lobe_planes(further, turns)
    assert {name: plane.shape[-1] for name, plane in planes.items()} == maps
    assert torch.equal(planes["third_edge"], PAINT[2, WIDTH:][3:6])
    assert turning_in(maps, 3) == turns and turning_in((), 1) == []
