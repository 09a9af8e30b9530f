"""The network of layered latents: it learns, resumes, treats channels alike, knows its encoder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from model_runtime.brdf.views import other_views, psnr_of, views
from model_runtime.errors import ModelFileError
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Latents
from training.baselines.layering import Layering, load_layering, random_stacks, train_layering
from training.baselines.weights import write_weights
from training.data.walks import Film, Ground, evaluate_stack
from training.evaluation.layers.evaluate import NETWORK
from training.loop import Run

pytestmark = pytest.mark.usefixtures("one_thread")


def learned(run: Run) -> Layering:
    return train_layering(run, "test", stacks=8, iterations=6)


def test_permuted_channels_permute_the_stack():
    g = torch.Generator().manual_seed(0)
    film, _ = random_stacks(16, g)
    under = Latents(torch.randn(16, 3, 4, generator=g), torch.randn(16, 12, generator=g))
    torch.manual_seed(0)
    network, turned = Layering(), [2, 0, 1]
    one = network(under, film)
    other = network(
        Latents(under.color[:, turned], under.shared), Film(film.alpha, film.depth[:, turned])
    )
    torch.testing.assert_close(other.color, one.color[:, turned])
    torch.testing.assert_close(other.shared, one.shared)


def test_random_grounds_give_back_no_more_than_they_take():
    film, ground = random_stacks(500, torch.Generator().manual_seed(0))
    assert float((ground.kd + ground.ks).max()) <= 1
    assert float(ground.kd.min()) >= 0
    assert float(film.depth.min()) == 0


def test_what_was_interrupted_ends_as_if_it_had_not(tmp_path: Path):
    def killed(_: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    whole = learned(Run(tmp_path / "whole.safetensors"))
    run = Run(tmp_path / "part.safetensors", save_every=0.0, watch=killed)
    with pytest.raises(KeyboardInterrupt):
        learned(run)
    again = learned(replace(run, resume=True, watch=None))
    for one, other in zip(whole.parameters(), again.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)
    assert not run.checkpoint.exists()


def test_it_knows_varnish_over_paint_and_over_metal():
    film = Film(torch.full((3,), 0.1), torch.tensor([[0.0] * 3, [0.0] * 3, [0.03, 0.11, 0.48]]))
    ground = Ground(
        torch.tensor([[0.5, 0.1, 0.1], [0.0] * 3, [0.0] * 3]),
        torch.tensor([[0.04] * 3, [1.0, 0.78, 0.34], [0.56] * 3]),
        torch.tensor([0.2, 0.15, 0.3]),
    )
    seen_from, (representation, _) = other_views(), load_representation()
    g = torch.Generator().manual_seed(0)
    walks = evaluate_stack(film, ground, seen_from.angles, walks=16, generator=g)
    under = representation.encode_parameters(ground.states())
    known = representation.decode(load_layering(NETWORK)(under, film), seen_from.angles)
    assert float(psnr_of(seen_from.seen(walks), seen_from.seen(known)).min()) > 36


def test_weights_of_another_encoder_are_refused(tmp_path: Path):
    path = tmp_path / "other.safetensors"
    write_weights(path, Layering(), {"run": {"encoder": "another"}})
    with pytest.raises(ModelFileError, match="another encoder"):
        load_layering(path)


def test_what_aging_looked_at_first_can_be_learned_from():
    views.cache_clear()
    with torch.inference_mode():
        views()
    f = torch.ones(1, len(views().angles), 3, requires_grad=True)
    views().seen(f).sum().backward()
    assert f.grad is not None
