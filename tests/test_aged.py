"""Effort: what a quality means, and that its knobs turn."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from model_runtime.age import AgeRequest, age
from model_runtime.model_files.weights import find_model
from model_runtime.modelling.aged import EFFORTS, Change, Effort, model_texels
from model_runtime.modelling.palette import appearance_psnr
from model_runtime.representation import load_representation
from model_runtime.representation.estimator import load_estimator
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.aging import Listener, contents, run

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def rust():
    representation, encoder = load_representation()
    return NeuralTemporalModel.load(find_model("rust"), encoder), representation


@pytest.fixture(scope="module")
def estimator():
    return load_estimator(load_representation()[1])


def texels(n: int) -> torch.Tensor:
    return torch.rand(n, 7, generator=torch.Generator().manual_seed(0)) * 0.5 + 0.1


def test_an_effort_that_is_given_is_spent_whatever_the_quality(paint: Path, tmp_path: Path):
    run(paint, tmp_path / "draft", frames=2, size=16, quality="draft")
    request = AgeRequest(paint, "rust", tmp_path / "given", frames=2, size=16)
    age(request, Listener(), EFFORTS["draft"])
    draft, given = (contents(tmp_path / name) for name in ("draft", "given"))
    assert draft.pop("aged.json") != given.pop("aged.json")
    assert draft == given


def test_finer_cells_are_nearer_to_each_texel_for_itself(rust):
    initial, change = texels(400), Change(rust[0], "lstm_parameters", rust[1])
    truth = model_texels(initial, change, EFFORTS["exact"])
    assert len(truth.palette.entries) == 400
    found = []
    for step in (0.4, 0.1, 0.02):
        aged = model_texels(initial, change, Effort(step=step, checked=False))
        found.append(appearance_psnr(truth.at(0.6), aged.at(0.6)))
    assert found == sorted(found)


def test_only_what_is_checked_is_made_finer(rust):
    coarse = Effort(step=0.4, checked=False)
    change = Change(rust[0], "lstm_parameters", rust[1])
    entries = [
        len(model_texels(texels(400), change, effort, tolerance=60).palette.entries)
        for effort in (coarse, replace(coarse, checked=True))
    ]
    assert entries[0] < entries[1]


def test_only_what_is_checked_says_what_it_misses(rust):
    said: list[str] = []
    change = Change(rust[0], "lstm_parameters", rust[1], warn=said.append)
    for checked in (False, True):
        effort = Effort(step=0.4, most=4, checked=checked)
        model_texels(texels(400), change, effort, tolerance=99)
    assert len(said) == 1 and "99 dB" in said[0]


class TestEstimator:
    """In place of the fit, where latents are rolled out."""

    @staticmethod
    def modeled(rust, estimator, effort: Effort, *, tolerance: float = math.inf, **options):
        change = Change(rust[0], "lstm_latents", rust[1], estimator, **options)
        return model_texels(texels(40), change, effort, tolerance=tolerance)

    def test_without_a_fit_it_is_asked_and_near_to_it(self, rust, estimator):
        draft = EFFORTS["draft"]
        fitted = self.modeled(rust, estimator, replace(draft, fit=True))
        told = self.modeled(rust, estimator, draft)
        assert not torch.equal(fitted.histories.states, told.histories.states)
        assert appearance_psnr(fitted.at(0.7), told.at(0.7)) > 35
        assert torch.equal(
            self.modeled(rust, None, draft).histories.states, fitted.histories.states
        )

    def test_where_it_misses_the_tolerance_there_is_a_fit(self, rust, estimator):
        balanced = EFFORTS["balanced"]
        fitted = self.modeled(rust, estimator, replace(balanced, fit=True), tolerance=20)
        for tolerance, equal in ((20, False), (90, True)):
            told = self.modeled(rust, estimator, balanced, tolerance=tolerance)
            same = torch.equal(fitted.histories.states[:, -1], told.histories.states[:, -1])
            assert same == equal, tolerance

    def test_one_material_all_over_is_fitted(self, rust, estimator):
        initial = texels(1).expand(5, 7)
        told, fitted = (
            model_texels(
                initial, Change(rust[0], "lstm_latents", rust[1], each), EFFORTS["balanced"]
            )
            for each in (estimator, None)
        )
        assert torch.equal(told.histories.states, fitted.histories.states)

    def test_one_specular_color(self, rust, estimator):
        told = self.modeled(rust, estimator, EFFORTS["draft"], specular="mono")
        ks = told.histories.states[..., 3:6]
        assert torch.equal(ks, ks[..., :1].expand_as(ks))

    def test_exact_does_not_ask_it(self, rust, estimator):
        exact = replace(EFFORTS["exact"], samples=None)
        assert torch.equal(
            self.modeled(rust, estimator, exact).histories.states,
            self.modeled(rust, None, exact).histories.states,
        )


def test_a_foreign_material_is_given_the_affine_rung(rust):
    ntm = rust[0]
    known = ntm.domain.centers[:500].square()
    assert ntm.suited(known) == (ntm.chosen, 0.0)
    assert ntm.suited(torch.full((9, 7), 3.9)) == ("affine", 1.0)
