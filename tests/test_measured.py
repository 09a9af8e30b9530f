"""Measured materials are looked at again: what is told of them is what would be seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from model_runtime.brdf import torrance_sparrow
from model_runtime.brdf.half_angle import cosines
from model_runtime.brdf.refinement import WELL_HELD, Measurements, fit_seen
from model_runtime.brdf.views import other_views, tone_map, views
from model_runtime.channels import optics
from model_runtime.representation import load_representation
from model_runtime.representation.measured import encode_measured
from training.data.nbrdf import load
from training.evaluation.bench.encoders import WEIGHTS, trained_encoder
from training.metric.sphere import Sphere, psnr

pytestmark = pytest.mark.usefixtures("one_thread")

Values = Callable[[Tensor], Tensor]

STATES = torch.tensor(
    ((0.2, 0.1, 0.05, 0.3, 0.2, 0.1, 0.2), (0.0, 0.3, 0.6, 0.04, 0.04, 0.04, 0.6))
)


def painted(angles: Tensor) -> Tensor:
    """f [2, M, 3] of two Torrance-Sparrow materials."""
    return torrance_sparrow.evaluate(*optics(STATES), angles)


def iridescent(angles: Tensor) -> Tensor:
    """f [1, M, 3] of a paint whose highlight turns from green to violet as light and eye part."""
    _, _, cos_h, cos_d = cosines(angles)
    phase = 9 * cos_d[:, None] + angles.new_tensor((0.0, 2.1, 4.2))
    flakes = 0.5 * (1 + phase.cos()) * torch.exp(-(1 - cos_h) / 0.06)[:, None]
    shine = torrance_sparrow.specular_lobe(torch.tensor((0.02,)), angles)[0, :, None]
    return (0.01 + 0.6 * flakes + 0.04 * shine)[None]


def hidden(evaluate: Values) -> Values:
    """The same, but for every seventh direction, which was not measured."""

    def some(angles: Tensor) -> Tensor:
        f = evaluate(angles)
        return f.masked_fill((torch.arange(f.shape[1]) % 7 == 0)[:, None], math.nan)

    return some


class TestViews:
    def test_a_white_wall_under_a_gray_sky_is_as_bright_as_it(self):
        seen = views().seen(torch.full((1, len(views().angles), 3), 1 / math.pi))
        torch.testing.assert_close(seen[:, :, -1], tone_map(torch.ones(1, 8, 3)), rtol=0.02, atol=0)

    def test_lamps_are_as_bright_as_their_sky_on_the_whole(self):
        seen = views().seen(torch.full((1, len(views().angles), 3), 1 / math.pi))
        assert 0.7 < float(seen[:, :, :-1].mean() / seen[:, :, -1:].mean()) < 1.1

    def test_nothing_of_what_judges_is_read(self):
        read, held_back = (each.angles[each.angles.any(1)] for each in (views(), other_views()))
        assert float(torch.cdist(read, held_back).min()) > 0

    @pytest.mark.parametrize("factor", [(0.5, 1.0), (1.0, 2.0)], ids=["darker", "rougher"])
    def test_it_tells_what_a_sphere_in_real_light_does(
        self, data_folder: Path, factor: tuple[float, float]
    ):
        changed = STATES * torch.tensor((factor[0],) * 6 + (factor[1],))

        def other(angles: Tensor) -> Tensor:
            return torrance_sparrow.evaluate(*optics(changed), angles)

        measured, angles = Measurements.of(painted), other_views().angles
        assert bool((measured.psnr(painted(angles)) == 100).all())
        sphere = Sphere.load(data_folder / "hdri", pixels=12)
        truth = psnr(sphere.render(painted), sphere.render(other)).mean(1)
        torch.testing.assert_close(measured.psnr(other(angles)), truth, rtol=0, atol=6)


class TestFit:
    def test_what_parameters_hold_they_hold(self):
        fit = fit_seen(painted)
        torch.testing.assert_close(fit.states, STATES, rtol=0.01, atol=0.003)
        assert bool((fit.db > WELL_HELD).all())

    def test_what_they_cannot_hold_they_show_as_well_as_they_can(self, data_folder: Path):
        nets = load(data_folder, "rgl-isotropic").select(["cm_white_rgb", "paper_green_rgb"])
        evaluate = _all(nets)
        fit = fit_seen(evaluate)
        sphere = Sphere.load(data_folder / "hdri", pixels=12)
        truth = sphere.render(evaluate)
        shown = sphere.render(lambda a: torrance_sparrow.evaluate(*optics(fit.states), a))
        assert bool((psnr(truth, shown).mean(1) > 28).all())  # by least squares: 21 and 22 dB

    def test_one_ks_for_all_channels_stays_one(self):
        fit = fit_seen(iridescent, "mono")
        _, ks, _ = optics(fit.states)
        assert float(ks.amax() - ks.amin()) == 0


class TestLatents:
    def test_an_unheard_of_paint_comes_back(self, data_folder: Path):
        ours, _ = load_representation()
        rival, _ = load_representation(trained_encoder("paper", WEIGHTS))
        sphere = Sphere.load(data_folder / "hdri", pixels=12)
        truth = sphere.render(iridescent)

        def reached(model, latents) -> float:
            shown = sphere.render(lambda angles: model.decode(latents, angles))
            return float(psnr(truth, shown).mean())

        with torch.no_grad():
            asked = rival.sample_angles(1024, measured=True)
            theirs = reached(rival, rival.encode(asked, iridescent(asked)))
            asked = ours.sample_angles(300, measured=True)
            once = reached(ours, ours.encode(asked, iridescent(asked)))
            encoded = encode_measured(ours, iridescent)
            again = reached(ours, encoded.latents)
        assert again > max(once, theirs, 18)
        assert float(encoded.db) == pytest.approx(again, abs=6)

    def test_what_is_held_well_is_left_alone(self, data_folder: Path):
        ours, _ = load_representation()
        evaluate = _all(load(data_folder, "merl").select(["dark-red-paint"]))
        asked = ours.sample_angles(300, measured=True)
        encoded = encode_measured(ours, evaluate)
        assert float(encoded.db) > WELL_HELD
        assert torch.equal(encoded.latents.flat(), ours.encode(asked, evaluate(asked)).flat())

    def test_each_is_refined_as_if_it_were_alone(self, data_folder: Path):
        ours, _ = load_representation()
        nets = load(data_folder, "rgl-isotropic").select(["cm_white_rgb", "satin_rosaline_rgb"])
        both = encode_measured(ours, _all(nets))
        alone = encode_measured(ours, _all(nets.select(["satin_rosaline_rgb"])))
        torch.testing.assert_close(both.db[1:], alone.db, rtol=0, atol=0.5)

    def test_again_the_same_and_in_inference_mode(self):
        ours, _ = load_representation()
        first = encode_measured(ours, iridescent).latents.flat()
        with torch.inference_mode():
            again, _ = load_representation()
            second = encode_measured(again, iridescent).latents.flat()
        assert torch.equal(first, second)

    def test_gaps_in_the_measurement_are_no_obstacle(self):
        ours, _ = load_representation()
        encoded = encode_measured(ours, hidden(iridescent))
        assert bool(encoded.latents.flat().isfinite().all())
        assert float(encoded.db) > 20


def _all(nets) -> Values:
    rows = torch.arange(len(nets))
    return lambda angles: nets.evaluate(rows, angles)
