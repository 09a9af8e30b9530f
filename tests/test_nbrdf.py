"""NBRDF, the rival that trains a network a material, against BRDFs given by a formula."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from model_runtime.brdf import torrance_sparrow
from model_runtime.brdf.half_angle import cosines
from model_runtime.representation.paper import PaperRepresentation
from training.baselines.nbrdf import PARAMETERS, Networks, Training, cached_fit, fit

pytestmark = pytest.mark.usefixtures("one_thread")

KD = torch.tensor([[0.5, 0.2, 0.1], [0.02, 0.02, 0.02], [0.3, 0.3, 0.6]])
KS = torch.tensor([[0.04, 0.04, 0.04], [0.9, 0.6, 0.3], [0.1, 0.1, 0.1]])
ALPHA = torch.tensor([0.5, 0.3, 0.15])
SHORT = Training(iterations=30, batch=64)


def truth(angles: Tensor) -> Tensor:
    return torrance_sparrow.evaluate(KD, KS, ALPHA, angles)


def directions(n: int) -> Tensor:
    return PaperRepresentation().sample_angles(n)


def loss(networks: Networks, angles: Tensor) -> Tensor:
    """The published loss of each network, written down again: [n]."""
    cos_i = cosines(angles)[0][:, None]
    estimate = networks.evaluate(torch.arange(len(networks)), angles)
    difference = torch.log(1 + truth(angles) * cos_i) - torch.log(1 + estimate * cos_i)
    return difference.abs().mean((1, 2))


def test_networks_learn_materials_at_directions_they_were_not_shown():
    angles = directions(6000)
    networks = fit(angles[:4000], truth(angles[:4000]), Training(iterations=1200))
    unseen = angles[4000:]
    mean = torch.log1p(truth(unseen) * cosines(unseen)[0][:, None]).mean((1, 2))
    assert (loss(networks, unseen) < 0.05 * mean).all()


def test_a_network_has_the_published_size():
    layers = fit(directions(32), truth(directions(32)), SHORT).layers
    assert PARAMETERS == 6 * 21 + 21 + 21 * 21 + 21 + 21 * 3 + 3
    assert sum(tensor[0].numel() for layer in layers for tensor in layer) == PARAMETERS


def test_values_are_finite_and_not_negative_and_rows_are_chosen_freely():
    angles = directions(500)
    networks = fit(angles, truth(angles) * 1000, SHORT)
    every = networks.evaluate(torch.arange(3), angles)
    assert torch.isfinite(every).all() and (every >= 0).all()
    torch.testing.assert_close(networks.evaluate(torch.tensor([2, 0]), angles), every[[2, 0]])


def test_the_same_seed_gives_the_same_networks_whoever_is_beside_them():
    angles = directions(200)
    together = fit(angles, truth(angles), SHORT)
    again = fit(angles, truth(angles), SHORT)
    alone = fit(angles, truth(angles)[1:2], SHORT)
    for layer, same, single in zip(together.layers, again.layers, alone.layers, strict=True):
        for tensor, equal, close in zip(layer, same, single, strict=True):
            assert torch.equal(tensor, equal)
            torch.testing.assert_close(tensor[1:2], close, rtol=1e-3, atol=1e-4)


def test_trained_networks_are_kept_for_the_same_samples_only(tmp_path: Path):
    path = tmp_path / "kept" / "three.safetensors"
    angles = directions(100)
    first = cached_fit(path, angles, truth(angles), SHORT)
    written = path.stat().st_mtime_ns
    kept = cached_fit(path, angles, truth(angles), SHORT)
    assert path.stat().st_mtime_ns == written
    assert kept.seconds == pytest.approx(first.seconds, abs=1e-3)
    assert torch.equal(kept.layers[0][0], first.layers[0][0])
    other = cached_fit(path, angles, 2 * truth(angles), SHORT)
    assert path.stat().st_mtime_ns != written
    assert not torch.equal(other.layers[0][0], first.layers[0][0])


@pytest.mark.parametrize("damage", ["empty", "truncated", "noise"])
def test_a_damaged_file_of_networks_is_made_again(tmp_path: Path, damage: str):
    path = tmp_path / "three.safetensors"
    angles = directions(100)
    first = cached_fit(path, angles, truth(angles), SHORT)
    whole = path.read_bytes()
    path.write_bytes({"empty": b"", "truncated": whole[:-100], "noise": b"\xff" * 500}[damage])
    again = cached_fit(path, angles, truth(angles), SHORT)
    assert torch.equal(again.layers[0][0], first.layers[0][0])
    assert len(path.read_bytes()) == len(whole)
