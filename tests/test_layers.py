"""Films: random walks through them, and the law in closed form that they are held against."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from model_runtime.brdf.half_angle import from_directions
from model_runtime.brdf.torrance_sparrow import evaluate
from model_runtime.brdf.views import other_views, psnr_of
from model_runtime.channels import optics
from model_runtime.errors import ModelFileError
from training.data.films import fresnel, ground_under, seen_through
from training.data.walks import Film, Ground, evaluate_stack
from training.evaluation.layers.evaluate import LAWS, evaluate_layers, table
from training.evaluation.layers.stacks import film, multiplied, refracted, under_varnish

pytestmark = pytest.mark.usefixtures("one_thread")

MATTE = ("white lead", "red earth", "azurite", "bone black")


def direction(cosine: float, turn: float) -> Tensor:
    sine = math.sqrt(1 - cosine**2)
    return torch.tensor((sine * math.cos(turn), sine * math.sin(turn), cosine))


def walked(alpha: float, depth: float, kd: float, ks: float, wi: Tensor, wo: Tensor, walks: int):
    film_of_one = Film(torch.tensor([alpha]), torch.full((1, 3), depth))
    ground = Ground(torch.full((1, 3), kd), torch.full((1, 3), ks), torch.tensor([0.3]))
    generator = torch.Generator().manual_seed(0)
    angles = from_directions(wi, wo)
    return evaluate_stack(film_of_one, ground, angles, walks=walks, generator=generator)[0, :, 0]


def test_a_smooth_film_over_a_matte_ground_is_what_optics_says():
    depth, albedo, ior = 0.3, 0.6, 1.5
    cosines = (0.9, 0.4)
    inside = [math.sqrt(1 - (1 - c * c) / ior**2) for c in cosines]
    grid = (np.arange(20_000) + 0.5) / 20_000
    back = (2 * grid * fresnel(grid, 1 / ior) * np.exp(-2 * depth / grid)).mean()
    passed = math.prod(
        (1 - fresnel(np.array(c), ior)) * math.exp(-depth / i)
        for c, i in zip(cosines, inside, strict=True)
    )
    expected = passed * albedo / math.pi / ior**2 / (1 - albedo * back)
    wi, wo = direction(cosines[0], 0.0)[None], direction(cosines[1], 1.0)[None]
    found = walked(0.002, depth, albedo, 0.0, wi, wo, 4_000)
    assert float(found) == pytest.approx(expected, rel=0.03)


def test_walks_go_both_ways():
    wi, wo = direction(0.9, 0.0)[None], direction(0.4, 1.0)[None]
    there, back = (walked(0.2, 0.2, 0.5, 0.2, *each, 8_000) for each in ((wi, wo), (wo, wi)))
    assert float(there) == pytest.approx(float(back), rel=0.05)


def test_nothing_is_lost_or_made_over_a_white_ground():
    generator = torch.Generator().manual_seed(1)
    u, v = torch.rand(2, 1_000, generator=generator)
    cosine, turn = (1 - u).sqrt(), 2 * math.pi * v
    wo = torch.stack((u.sqrt() * turn.cos(), u.sqrt() * turn.sin(), cosine), -1)
    wi = direction(0.7, 0.0).expand_as(wo)
    assert float(walked(0.05, 0.0, 1.0, 0.0, wi, wo, 4).mean() * math.pi) == pytest.approx(
        1, abs=0.04
    )


def test_a_clear_film_changes_nothing_and_a_deep_one_pale_grounds_most():
    body = np.linspace(0.02, 0.98, 25)
    under = ground_under(body, 1.5)
    np.testing.assert_allclose(seen_through(under, 0.0, 1.5), body, rtol=1e-6)
    kept = [seen_through(under, depth, 1.5) / body for depth in (0.1, 0.5, 2.0)]
    assert all((np.diff(each) < 0).all() for each in kept)
    assert (kept[0] > kept[1]).all() and (kept[1] > kept[2]).all()


def test_a_film_that_neither_bends_nor_absorbs_leaves_the_ground_as_it_is():
    ground = Ground(torch.full((1, 3), 0.3), torch.tensor([[0.5, 0.3, 0.1]]), torch.tensor([0.3]))
    nothing = Film(torch.tensor([0.1]), torch.zeros(1, 3), ior=1.0001)
    wi = torch.stack((direction(0.9, 0.0), direction(0.6, 0.0)))
    angles = from_directions(wi, torch.stack((direction(0.8, 2.8), direction(0.7, 1.5))))
    generator = torch.Generator().manual_seed(0)
    walks = evaluate_stack(nothing, ground, angles, walks=4, generator=generator)
    torch.testing.assert_close(
        walks, evaluate(*optics(ground.states()), angles), rtol=0.01, atol=0.001
    )


@pytest.mark.parametrize("alpha", [0.05, 0.15])
def test_laws_are_the_nearer_to_walks_the_more_they_know(alpha: float):
    """Light is bent, reflected inside, and absorbed on slanted ways."""
    views, generator = other_views(), torch.Generator().manual_seed(0)
    for age in (0.0, 1.0):
        stacks = under_varnish(alpha, age, MATTE)
        walks = evaluate_stack(
            stacks.film, stacks.ground, views.angles, walks=4, generator=generator
        )
        by_crossing, by_film, by_direction = (
            psnr_of(views.seen(walks), views.seen(law(stacks, views.angles)))
            for law in (multiplied, film, refracted)
        )
        assert (by_direction > by_film).all()
        if age == 0:
            torch.testing.assert_close(by_film, by_crossing)
        else:
            assert float(by_film.min()) > 29
            assert float(by_film[0] - by_crossing[0]) > 4, "most over pale grounds"


def test_the_smoother_the_film_the_nearer_is_refraction():
    views, generator = other_views(), torch.Generator().manual_seed(0)
    found = []
    for alpha in (0.005, 0.15):
        stacks = under_varnish(alpha, 0.5, ("red earth", "glossy red paint"))
        walks = evaluate_stack(
            stacks.film, stacks.ground, views.angles, walks=4, generator=generator
        )
        found.append(psnr_of(views.seen(walks), views.seen(refracted(stacks, views.angles))))
    assert float(found[0].min()) > 40
    assert (found[0] > found[1]).all()


def test_a_report_has_a_row_a_ground_and_a_column_a_law(tmp_path: Path):
    names = ("azurite", "gold")
    report = evaluate_layers(tmp_path, walks=1, grounds=names, ages=(1.0,), roughness=(0.15,))
    assert tuple(row.ground for row in report.rows) == names
    lines = table(report).splitlines()
    assert len(lines) == 2 + len(names)
    assert all(line.count("|") == 2 + len(LAWS) for line in lines)
    assert (tmp_path / "layers.md").read_text() == table(report) + "\n"
    for row in report.rows:
        assert row.network > row.multiplied, row.ground


def test_without_the_network_there_is_no_report_but_a_sentence(tmp_path: Path):
    with pytest.raises(ModelFileError, match="weights of layering are missing") as told:
        evaluate_layers(tmp_path, weights=tmp_path / "layering.safetensors")
    assert "python -m training layering" in str(told.value)
