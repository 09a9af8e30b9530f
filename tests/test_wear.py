"""Wear that is there: texels that have begun already, by the course that all materials take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.brdf import principled
from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import find_model
from model_runtime.reading.inputs import read_input
from model_runtime.representation import load_representation
from model_runtime.temporal.domain import perceptual
from model_runtime.temporal.ntm import NeuralTemporalModel
from model_runtime.temporal.wear import course_of


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
    age = course_of(ntm_of("rust")).age_of(texels_of(data_folder / "pbr" / "Rust004"))
    assert (age > 0.5).float().mean() > 0.8


@pytest.mark.parametrize("name", ["rust", "patina", "moss", "char", "soiling"])
def test_what_is_on_the_course_only_ages(name: str):
    course = course_of(ntm_of(name))
    assert course.ages[-1] == 1 and (course.age_of(course.states[1:]) == course.ages[1:]).all()
    start = course.states[[1, -1]]
    change = course.onward(course.age_of(start), 9)
    assert (change[:, 0] == 0).all() and (change[1] == 0).all()
    away = (perceptual(start[:1] + change[0]) - perceptual(course.states[-1:])).norm(dim=-1)
    assert away[-1] < 1e-3 and away[-1] < away[0]


@pytest.mark.parametrize("name", ["fading", "yellowing"])
def test_a_process_without_a_common_end_leaves_no_wear(name: str):
    course = course_of(ntm_of(name))
    assert len(course.ages) == 0
    assert not course.age_of(torch.rand(100, 7)).any()
