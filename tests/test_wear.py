"""Wear that is there: texels that have begun already, by the course that all materials take."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from model_runtime.backend import torch
from model_runtime.brdf import principled
from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import find_model
from model_runtime.reading.inputs import read_input
from model_runtime.representation import load_representation
from model_runtime.states import perceptual
from model_runtime.temporal.ntm import NeuralTemporalModel
from model_runtime.temporal.onset import onset_map
from model_runtime.temporal.wear import course_of, stains_of
from tests.aging import frames_of, run


def ntm_of(name: str) -> NeuralTemporalModel:
    return NeuralTemporalModel.load(find_model(name), load_representation()[1])


def texels_of(folder: Path, size: int = 96) -> torch.Tensor:
    material = read_input(folder, size=size)
    assert isinstance(material, PrincipledMaps)
    maps = principled.forward(material)
    flat = np.concatenate((maps.kd, maps.ks, maps.alpha[..., None]), -1).reshape(-1, 7)
    return torch.from_numpy(flat.astype(np.float32))


def test_rust_that_is_there_is_found_and_paint_is_not_taken_for_it(data_folder: Path):
    course = course_of(ntm_of("rust"))
    rusty, clean = (data_folder / "scans" / name for name in ("PaintedMetal007", "../pbr/Metal032"))
    texels = texels_of(rusty)
    age = course.age_of(texels)
    brown = texels[:, 0] > 2 * texels[:, 2]  # its paint is blue, its rust red
    assert (age > 0)[brown].float().mean() > 0.8
    assert (age > 0)[~brown].float().mean() < 0.02
    assert not (course.age_of(texels_of(clean)) > 0).any()


def test_a_rusted_material_is_old_all_over(data_folder: Path):
    texels = texels_of(data_folder / "pbr" / "Rust004")
    age = course_of(ntm_of("rust")).widened_to(texels).age_of(texels)
    assert (age > 0.5).float().mean() > 0.8


@pytest.mark.parametrize("name", ["rust", "patina", "moss", "char", "soiling"])
def test_what_is_on_the_course_only_ages(name: str):
    course = course_of(ntm_of(name))
    later = course.ages > course.ages[0] + 0.1
    assert course.ages[-1] == 1
    assert (course.age_of(course.states[later]) == course.ages[later]).all()
    start = course.states[later][[0, -1]]
    change = course.onward(course.age_of(start), 9)
    assert (change[:, 0] == 0).all() and (change[1] == 0).all()
    away = (perceptual(start[:1] + change[0]) - perceptual(course.states[-1:])).norm(dim=-1)
    assert away[-1] < 1e-3 and away[-1] < away[0]


@pytest.mark.parametrize("name", ["drying", "fading", "yellowing"])
def test_a_process_without_a_common_end_leaves_no_wear(name: str):
    course = course_of(ntm_of(name))
    assert len(course.ages) == 0
    states = np.random.default_rng(0).random((100, 7), np.float32)
    assert not course.age_of(torch.from_numpy(states)).any()


def test_what_grows_starts_around_what_is_worn():
    worn = np.zeros((96, 96), bool)
    worn[40:48, 40:48] = True
    onset = onset_map("rust", worn.shape, seed=3, worn=worn)
    without = onset_map("rust", worn.shape, seed=3)
    beside = np.zeros_like(worn)
    beside[36:52, 36:52] = True
    beside &= ~worn
    assert (onset[worn] == 0).all()
    assert onset[beside].mean() < 0.5 * without[beside].mean()
    assert abs(np.median(onset[~worn]) - np.median(without)) < 0.05, "the pace is as ever"


def test_rust_of_a_scan_goes_on_and_never_gets_younger(data_folder: Path, tmp_path: Path):
    account = run(
        data_folder / "scans" / "PaintedMetal007",
        tmp_path / "aged",
        frames=5,
        size=64,
        format="torrance-sparrow",
    )
    assert 0.05 < account["worn"] < 0.2
    kd, ks, alpha = (frames_of(tmp_path / "aged", name, 5) for name in ("kd", "ks", "alpha"))
    states = np.concatenate((kd, ks, alpha[..., None]), -1).reshape(5, -1, 7)
    course = course_of(ntm_of("rust"))
    first, *later = (course.age_of(torch.from_numpy(frame.astype(np.float32))) for frame in states)
    worn = first > 0.25
    assert all((after[worn] > first[worn] - 0.1).float().mean() > 0.95 for after in later)
    assert first[worn].mean() < later[-1][worn].mean()
    assert later[-1][worn].mean() > 0.95  # it has gone on to the end


@pytest.mark.parametrize("name", ["rust", "patina", "moss", "soiling", "fading"])
def test_a_stain_is_a_state_that_shows_and_is_young(name: str):
    """The stronger it is the farther it has come, the strongest most of the way and half as old."""
    ntm = ntm_of(name)
    stains = stains_of(ntm)
    assert stains[0] == 0 and all(a < b for a, b in pairwise(stains))
    assert stains[-1] < 0.8
    start = ntm.domain.centers[:64].square()
    model = ntm.affine if ntm.chosen in ("constant", "affine") else ntm.parameters
    seen = perceptual(model.rollout(start, ntm.frames))
    gone = (seen - seen[:, :1]).norm(dim=-1).mean(0)
    place = round(stains[-1] * (ntm.frames - 1))
    assert 0.7 < float(gone[place] / gone[-1]) < 1
