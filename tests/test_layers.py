"""Films: random walks through them, and the law in closed form that they are held against."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from model_runtime.brdf.half_angle import from_directions
from training.data.films import fresnel, ground_under, seen_through
from training.evaluation.layers.evaluate import evaluate_layers, table
from training.evaluation.layers.walks import Film, Ground, evaluate_stack


def direction(cosine: float, turn: float) -> Tensor:
    sine = math.sqrt(1 - cosine**2)
    return torch.tensor((sine * math.cos(turn), sine * math.sin(turn), cosine))


def walked(alpha: float, depth: float, kd: float, ks: float, wi: Tensor, wo: Tensor, walks: int):
    film = Film(torch.tensor([alpha]), torch.full((1, 3), depth))
    ground = Ground(torch.full((1, 3), kd), torch.full((1, 3), ks), torch.tensor([0.3]))
    generator = torch.Generator().manual_seed(0)
    angles = from_directions(wi, wo)
    return evaluate_stack(film, ground, angles, walks=walks, generator=generator)[0, :, 0]


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


def test_the_law_of_films_is_nearer_to_walks_than_crossing_twice(tmp_path: Path):
    report = evaluate_layers(tmp_path, walks=1)
    aged = [row for row in report.rows if row.age > 0]
    for row in aged:
        assert min(row.film) > 29
        assert row.film[0] > row.multiplied[0] + 4, "most over pale grounds"
    clear = next(row for row in report.rows if row.age == 0)
    assert clear.film == clear.multiplied
    assert table(report).count("\n") == 1 + len(report.rows)
    assert (tmp_path / "layers.md").read_text() == table(report) + "\n"
