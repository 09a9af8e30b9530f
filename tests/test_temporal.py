"""Models of change: what each must be able to do, what an untrained one does, which file is
refused, and how histories are counted from their onset.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from model_runtime.contract import LADDER
from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import save_model
from model_runtime.temporal.domain import MOST_CENTERS, Domain
from model_runtime.temporal.models import Affine, Constant, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel
from model_runtime.temporal.pace import Timing
from tests.random_histories import histories_of, random_maps
from training.data.synthetic import s1, s2

ENCODER = "0123456789abcdef"


class TestConstant:
    def test_nothing_changes(self):
        state = torch.rand(4, 7)
        history = Constant().rollout(state, 5)
        assert history.shape == (4, 5, 7)
        assert bool((history == state[:, None]).all())


class TestAffine:
    @pytest.mark.parametrize("model", [s1, s2], ids=["S1", "S2"])
    @pytest.mark.parametrize("a", [0.3, 0.6, 1.0])
    def test_the_paper_s_synthetic_models_are_solved(self, model, a: float):
        """S1 and S2 are affine in the initial value, so other materials' histories follow too."""
        source, target = (histories_of(model(random_maps(12, seed), a)) for seed in (1, 2))
        affine = Affine.fit(source, torch.ones(source.shape[:2], dtype=torch.bool))
        torch.testing.assert_close(affine.rollout(target[:, 0], 36), target, rtol=1e-3, atol=1e-4)

    def test_the_first_entry_is_the_state_itself(self):
        histories = torch.rand(50, 6, 7)
        affine = Affine.fit(histories, torch.ones(50, 6, dtype=torch.bool))
        state = torch.rand(3, 7)
        torch.testing.assert_close(affine.rollout(state, 6)[:, 0], state, rtol=0, atol=0)

    def test_what_was_not_observed_does_not_count(self):
        start = torch.rand(100, 1, 7)
        age = torch.linspace(0, 1, 5)[:, None]
        histories = (1 - 0.5 * age) * start + 0.2 * age
        observed = torch.rand(100, 5) < 0.6
        observed[:, 0] = True
        broken = torch.where(observed[..., None], histories, torch.tensor(99.0))
        affine = Affine.fit(broken, observed)
        torch.testing.assert_close(affine.gain, (1 - 0.5 * age).expand(5, 7), rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(affine.offset, (0.2 * age).expand(5, 7), rtol=1e-3, atol=1e-4)

    def test_an_age_that_nothing_was_observed_at_is_as_the_one_before(self):
        """Where every history starts late, none is seen to its end."""
        start = torch.rand(50, 1, 7)
        age = torch.linspace(0, 1, 5)[:, None]
        histories = (1 - 0.5 * age) * start + 0.2 * age
        observed = torch.arange(5).expand(50, 5) < 3
        rolled = Affine.fit(histories, observed).rollout(start[:, 0], 5)
        torch.testing.assert_close(rolled[:, :3], histories[:, :3], rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(rolled[:, 3:], rolled[:, 2:3].expand(-1, 2, -1))

    def test_one_material_alone_keeps_its_differences(self):
        """Where nothing varies, no gain can be learned: 1, and the whole change is an offset."""
        history = torch.linspace(0.2, 0.6, 4)[:, None].expand(4, 7)
        affine = Affine.fit(history.expand(30, -1, -1), torch.ones(30, 4, dtype=torch.bool))
        assert bool((affine.gain == 1).all())
        torch.testing.assert_close(affine.rollout(torch.full((1, 7), 0.2), 4)[0], history)

    def test_noise_makes_no_wild_gains(self):
        g = torch.Generator().manual_seed(0)
        histories = 0.3 + 2e-4 * torch.randn(40, 6, 7, generator=g)
        histories[:, 1:] += 0.5 * torch.rand(40, 5, 7, generator=g)
        affine = Affine.fit(histories, torch.ones(40, 6, dtype=torch.bool))
        assert float(affine.gain.min()) >= 0
        assert float(affine.gain.max()) < 10


@pytest.mark.parametrize("make", [ParameterLSTM, lambda: LatentLSTM(4, 3)], ids=["7", "4 + 3"])
class TestLSTM:
    def test_untrained_it_is_constant(self, make):
        model = make()
        state = torch.randn(5, 7)
        with torch.no_grad():
            history = model.rollout(state, 9)
        torch.testing.assert_close(history, state[:, None].expand(-1, 9, -1), rtol=0, atol=1e-6)

    def test_and_still_when_standardized(self, make):
        model = make()
        seen = torch.rand(200, 9, 7) * torch.tensor((1, 10, 0.1, 1, 5, 1, 0.01)) + 3
        model.standardize(seen)
        torch.testing.assert_close(model.mean, seen.mean((0, 1)), rtol=1e-4, atol=1e-5)
        with torch.no_grad():
            history = model.rollout(seen[:20, 0], 9)
        torch.testing.assert_close(history, seen[:20, :1].expand(-1, 9, -1), rtol=1e-4, atol=1e-5)

    def test_no_rollout_runs_away(self, make):
        torch.manual_seed(0)
        model = make()
        with torch.no_grad():
            for p in model.parameters():
                p.normal_(0, 30)
            history = model.rollout(torch.randn(5, 7) * 1e6, 200)
        assert bool(torch.isfinite(history).all())
        assert float(history[:, 1:].abs().max()) <= 8

    def test_the_first_entry_is_the_state_itself(self, make):
        torch.manual_seed(0)
        model = make()
        with torch.no_grad():
            for p in model.parameters():
                p.normal_()
            state = torch.randn(5, 7) * 20
            assert torch.equal(model.rollout(state, 3)[:, 0], state)

    def test_materials_do_not_mix(self, make):
        torch.manual_seed(0)
        model = make()
        with torch.no_grad():
            for p in model.parameters():
                p.normal_(0, 0.3)
            state = torch.randn(6, 7)
            whole = model.rollout(state, 8)
            alone = torch.cat([model.rollout(row[None], 8) for row in state])
        torch.testing.assert_close(alone, whole, rtol=1e-5, atol=1e-6)


def test_color_and_shared_latents_do_not_see_each_other():
    """Two LSTMs, as in figure 4 of the paper."""
    torch.manual_seed(0)
    model = LatentLSTM(4, 3)
    with torch.no_grad():
        for p in model.parameters():
            p.normal_()
        state = torch.randn(2, 7)
        other = state.clone()
        other[:, 4:] += 1
        one, changed = model.rollout(state, 6), model.rollout(other, 6)
    assert torch.equal(one[..., :4], changed[..., :4])
    assert not torch.equal(one[:, -1, 4:], changed[:, -1, 4:])


class TestDomain:
    @staticmethod
    def steels(n: int, seed: int = 0) -> torch.Tensor:
        g = torch.Generator().manual_seed(seed)
        kd = 0.02 + 0.02 * torch.rand(n, 3, generator=g)
        ks = 0.5 + 0.1 * torch.rand(n, 1, generator=g).expand(n, 3)
        return torch.cat((kd, ks, 0.1 + 0.1 * torch.rand(n, 1, generator=g)), 1)

    def test_what_it_saw_and_the_like_of_it_are_inside(self):
        domain = Domain.of(self.steels(2000))
        assert not bool(domain.outside(self.steels(2000)).any())
        assert float(domain.outside(self.steels(500, seed=1)).float().mean()) < 0.01

    @pytest.mark.parametrize(
        "other",
        [(0.9, 0.9, 0.9, 0.04, 0.04, 0.04, 0.3), (0, 0, 0, 0.9, 0.1, 0.1, 0.15)],
        ids=["white paint", "a red metal"],
    )
    def test_far_materials_are_outside(self, other):
        domain = Domain.of(self.steels(2000))
        mixed = torch.cat((self.steels(3), torch.tensor([other])))
        assert domain.outside(mixed).tolist() == [False, False, False, True]

    def test_a_gap_between_two_kinds_stays_a_gap(self):
        """One kind is spread wide, the other is narrow: each keeps its own distances."""
        paints = self.steels(3000)
        paints[:, :3] = 0.1 + 0.8 * torch.rand(3000, 3, generator=torch.Generator().manual_seed(1))
        paints[:, 3:6] = 0.04
        domain = Domain.of(torch.cat((self.steels(3000), paints)))
        between = torch.lerp(self.steels(100, seed=2), paints[:100], 0.5)
        assert bool(domain.outside(between).all())
        redder = self.steels(100, seed=3)
        redder[:, 4:6] *= 0.6
        assert bool(domain.outside(redder).all())

    def test_distance_is_0_at_a_center_and_1_at_the_border(self):
        center = torch.full((1, 7), 0.25)
        domain = Domain(torch.cat((center.sqrt(), torch.ones(1, 7))), torch.tensor((0.2, 0.1)))
        away = center.repeat(4, 1)
        away[:, 6] = torch.tensor((0.5, 0.6, 0.7, 0.8)).square()
        expected = torch.tensor((0, 0.5, 1.0, 1.5))
        torch.testing.assert_close(domain.distance(away), expected, rtol=1e-3, atol=1e-2)
        assert domain.outside(away)[[0, 1, 3]].tolist() == [False, False, True]

    def test_the_number_of_texels_asked_about_does_not_matter(self):
        domain, others = Domain.of(self.steels(600)), torch.rand(1500, 7)
        alone = torch.cat([domain.distance(row[None]) for row in others[:20]])
        torch.testing.assert_close(domain.distance(others)[:20], alone, rtol=1e-4, atol=1e-4)
        assert domain.outside(others[:0]).shape == (0,)

    def test_the_same_materials_give_the_same_domain(self):
        one, other = (Domain.of(self.steels(500), seed=3) for _ in range(2))
        assert torch.equal(one.centers, other.centers)
        assert torch.equal(one.radii, other.radii)

    @pytest.mark.parametrize("n", [1, 2, 7, 14, 3000])
    def test_of_any_number_of_materials(self, n: int):
        domain = Domain.of(self.steels(n))
        assert domain.centers.shape == (len(domain.radii), 7)
        assert 0 < len(domain.radii) <= MOST_CENTERS
        assert bool((domain.radii >= 0.05).all())
        assert not bool(domain.outside(self.steels(n)[:1]).any())
        assert bool(domain.outside(torch.full((1, 7), 0.95)).all())

    def test_one_material_alone_is_inside_and_no_other(self):
        domain = Domain.of(torch.full((500, 7), 0.3))
        assert domain.outside(torch.tensor([[0.3] * 7, [0.4] * 7])).tolist() == [False, True]


@pytest.fixture
def ntm_file(tmp_path: Path):
    """Writes an NTM of 5 frames; keywords change its card, `tensors` its content."""
    frames, path = 5, tmp_path / "moss.safetensors"
    affine = Affine(torch.ones(frames, 7), torch.zeros(frames, 7))
    parts = {
        "affine.gain": affine.gain,
        "affine.offset": affine.offset,
        "domain.centres": torch.rand(3, 7),
        "domain.radii": torch.tensor((0.1, 0.2, 0.3)),
        **{f"parameters.{k}": v for k, v in ParameterLSTM().state_dict().items()},
        **{f"latents.{k}": v for k, v in LatentLSTM(12, 8).state_dict().items()},
    }
    card = {
        "name": "moss",
        "title": "Moss",
        "frames": frames,
        "representation": ENCODER,
        "domain": {"ranges": {"alpha": [0.1, 0.4]}},
        "temporal_model": "affine",
    }

    def write(*, tensors: Mapping[str, torch.Tensor | None] = {}, **changes: Any) -> Path:
        content = {k: v for k, v in {**parts, **tensors}.items() if v is not None}
        save_model(path, content, card | changes, kind="ntm")
        return path

    return write


class TestNTM:
    def test_what_was_saved_comes_back(self, ntm_file):
        ntm = NeuralTemporalModel.load(ntm_file(), ENCODER)
        assert (ntm.chosen, ntm.frames) == ("affine", 5)
        assert ntm.card.title == "Moss"
        for name in LADDER:
            size = 20 if name == "lstm_latents" else 7
            history = ntm.rung(name).rollout(torch.rand(3, size), 5)
            assert history.shape == (3, 5, size)
        stored = load_file(ntm.card.path)
        assert stored.keys() == ntm.tensors().keys()
        for name, value in ntm.tensors().items():
            assert torch.equal(value, stored[name])
        assert not any(p.requires_grad for p in ntm.latents.parameters())

    def test_its_timing(self, ntm_file):
        assert NeuralTemporalModel.load(ntm_file(), ENCODER).timing is None
        timing = Timing.of(np.linspace(0, 1, 9), 0.8, scale=0.05)
        path = ntm_file(timing=timing.json())
        assert NeuralTemporalModel.load(path, ENCODER).timing == timing

    def test_another_encoder_s_is_refused_and_says_so(self, ntm_file):
        with pytest.raises(ModelFileError, match=r"another encoder .*feedbeef"):
            NeuralTemporalModel.load(ntm_file(representation="feedbeef"), ENCODER)

    def test_a_missing_one(self, tmp_path: Path):
        with pytest.raises(ModelFileError, match="no model file"):
            NeuralTemporalModel.load(tmp_path / "none.safetensors", ENCODER)

    def test_an_encoder_is_none(self, tmp_path: Path):
        path = tmp_path / "encoder.safetensors"
        save_model(path, {"w": torch.zeros(1)}, {"name": "lobes"}, kind="encoder")
        with pytest.raises(ModelFileError, match="not an ntm"):
            NeuralTemporalModel.load(path, ENCODER)

    @pytest.mark.parametrize(
        "change",
        [
            {"frames": 6},
            {"temporal_model": "transformer"},
            {"temporal_model": None},
            {"timing": []},
            {"timing": {"onset": [2.0] * 33, "rate": [1.0] * 33, "scale": None}},
            {"timing": {"onset": [0.0] * 9, "rate": [1.0] * 33, "scale": None}},
            {"tensors": {"affine.gain": None}},
            {"tensors": {"affine.gain": torch.zeros(5, 6)}},
            {"tensors": {"affine.offset": torch.zeros(4, 7)}},
            {"tensors": {"domain.centres": torch.zeros(3, 6)}},
            {"tensors": {"domain.centres": torch.zeros(0, 7)}},
            {"tensors": {"affine.gain": torch.full((5, 7), -1.0)}},
            {"tensors": {"affine.gain": torch.full((5, 7), 9.0)}},
            {"tensors": {"affine.offset": torch.full((5, 7), 3e38)}},
            {"tensors": {"latents.scale": torch.full((20,), 3e38)}},
            {"tensors": {"domain.centres": torch.zeros(7)}},
            {"tensors": {"domain.centres": torch.zeros(2049, 7), "domain.radii": torch.ones(2049)}},
            {"tensors": {"domain.radii": None}},
            {"tensors": {"domain.radii": torch.ones(2)}},
            {"tensors": {"domain.radii": torch.ones(3, 1)}},
            {"tensors": {"domain.radii": torch.tensor((0.1, 0.0, 0.1))}},
            {"tensors": {"domain.radii": torch.tensor((0.1, -1.0, 0.1))}},
            {"tensors": {"domain.radii": torch.tensor((0.1, float("inf"), 0.1))}},
            {"tensors": {"parameters.mean": None}},
            {"tensors": {"parameters.step.weight": torch.zeros(7, 3)}},
            {"tensors": {"parameters.extra": torch.zeros(1)}},
            {"tensors": {"latents.steps.0.bias": None}},
            {"tensors": {"latents.steps.0.bias": torch.tensor(0.0)}},
            {"tensors": {"latents.steps.1.bias": torch.zeros(9)}},
            {"tensors": {"latents.mean": torch.full((20,), float("nan"))}},
            {
                "frames": 0,
                "tensors": {
                    "affine.gain": torch.zeros(0, 7),
                    "affine.offset": torch.zeros(0, 7),
                },
            },
        ],
        ids=str,
    )
    def test_damage_is_refused_with_a_sentence(self, ntm_file, change: dict[str, Any]):
        with pytest.raises(ModelFileError) as error:
            NeuralTemporalModel.load(ntm_file(**change), ENCODER)
        assert "moss.safetensors" in error.value.message
        assert error.value.hint
