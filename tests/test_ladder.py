"""The ladder of models of change: what is held out, how a rung is scored, which is chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from model_runtime.contract import LADDER
from model_runtime.model_files.weights import ModelCard
from model_runtime.representation import build
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import Affine, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel
from training.data.sequences import MixtureSequence
from training.evaluation.synthesis.cases import mixed_weights
from training.ladder import (
    choose,
    held_out_ranges,
    held_out_texels,
    score,
    suffices,
    widest_channel,
)
from training.loop import Run
from training.ntm import NTMConfig, train_ladder
from training.source.histories import SourceHistories, source_histories

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = NTMConfig(iterations=4, batch=16, warm_up=1)
LATENTS = sum(build("lobes").latent_sizes)


@pytest.fixture(scope="module")
def representation():
    torch.manual_seed(0)
    return build("lobes").eval()


def histories(n: int, frames: int = 4, *, curved: bool = False) -> SourceHistories:
    """Texels whose Ks differ most; each darkens by half or, `curved`, as its own square."""
    g = torch.Generator().manual_seed(0)
    start = 0.3 + 0.02 * torch.rand(n, 7, generator=g)
    start[:, 3:6] = torch.linspace(0.05, 0.9, n)[torch.randperm(n, generator=g), None]
    age = torch.linspace(0, 1, frames)[:, None]
    end = start.square() if curved else 0.5 * start
    states = torch.lerp(start[:, None], end[:, None], age)
    observed = torch.ones(n, frames, dtype=torch.bool)
    return SourceHistories(states, torch.rand(n, frames, LATENTS, generator=g), observed)


def model(source: SourceHistories, representation) -> NeuralTemporalModel:
    """Its affine rung fitted, its LSTMs untrained."""
    frames = source.parameters.shape[1]
    return NeuralTemporalModel(
        ModelCard(Path("x"), "ntm", 1, "", "", frames=frames),
        Affine.fit(source.parameters, source.observed),
        ParameterLSTM(),
        LatentLSTM(*representation.latent_sizes),
        Domain.of(source.parameters[:, 0]),
    )


class TestSplits:
    def test_a_tenth_is_held_out_and_nothing_is_in_both(self):
        source = histories(200)
        split = held_out_texels(source, seed=1)
        assert (len(split.train.parameters), len(split.test.parameters)) == (180, 20)
        both = torch.cat((split.train.parameters, split.test.parameters))[:, 0]
        assert len(both.unique(dim=0)) == 200
        again = held_out_texels(source, seed=1)
        assert torch.equal(again.test.parameters, split.test.parameters)

    def test_ranges_are_tested_beyond_what_they_are_trained_on(self):
        for name, part in held_out_ranges(histories(1000), 3).items():
            train, test = (some.parameters[:, 0, 3] for some in (part.train, part.test))
            assert len(train) == 700
            assert len(test) == 256
            low, high = (train, test) if name == "above" else (test, train)
            assert float(low.max()) < float(high.min())
            reached = high.max() if name == "above" else low.min()
            assert float(reached) == pytest.approx(0.9 if name == "above" else 0.05)

    def test_the_channel_is_the_one_that_looks_most_different(self):
        source = histories(50)
        assert widest_channel(source) in (3, 4, 5)
        alpha = source.parameters.clone()
        alpha[:, :, 6] = torch.linspace(1e-4, 1, 50)[:, None]
        assert widest_channel(replace(source, parameters=alpha)) == 6

    @pytest.mark.parametrize("n", [1, 2, 3, 9])
    def test_of_few_texels_no_side_is_empty(self, n: int):
        source = histories(n)
        for split in (held_out_texels(source, 0), *held_out_ranges(source, 3).values()):
            assert len(split.train.parameters) >= 1
            assert len(split.test.parameters) >= 1

    def test_texels_that_are_all_alike_are_parted_all_the_same(self):
        source = histories(40)
        alike = replace(source, parameters=source.parameters[:1].expand(40, -1, -1))
        for split in held_out_ranges(alike, widest_channel(alike)).values():
            assert (len(split.train.parameters), len(split.test.parameters)) == (28, 12)


class TestScore:
    def test_by_hand(self, representation):
        source = histories(60)
        ntm = model(source, representation)
        assert score("affine", ntm, source, representation) > 80
        assert score("constant", ntm, source, representation) < 40

    def test_only_what_was_observed_counts(self, representation):
        source = histories(30)
        broken, observed = source.parameters.clone(), source.observed.clone()
        broken[:, 2:], observed[:, 2:] = 0.99, False
        some = replace(source, parameters=broken, observed=observed)
        assert score("affine", model(source, representation), some, representation) > 80

    def test_where_nothing_was_observed_nothing_is_missed(self, representation):
        source = histories(30)
        observed = source.observed.clone()
        observed[:, 1:] = False
        unseen = replace(source, observed=observed)
        for rung in LADDER:
            assert score(rung, model(source, representation), unseen, representation) == 100

    def test_mixtures_are_compared_as_brdfs(self, data_folder, representation):
        """The last rung with the values it decodes, the others with their parameters' values: no
        fit hides what a lobe misses.
        """
        weights = mixed_weights(6, 1)[::7]
        times = torch.linspace(0, 1, len(weights)).numpy()
        mixture = MixtureSequence(("alum-bronze", "dark-red-paint"), weights, times, "x")
        source = source_histories(mixture, representation)
        assert source.mixture is not None
        angles = torch.tensor([[0.1, 0.4, 0.0], [0.5, 0.2, 1.0]])
        values = source.mixture.evaluate(angles)
        assert values.shape == (36, len(weights), 2, 3)
        first, second = source.mixture.pure(angles)
        share = float(torch.from_numpy(weights).flatten(1)[2, 7])
        torch.testing.assert_close(values[7, 2], (1 - share) * first + share * second)
        one = source.select(torch.tensor([7])).mixture
        assert one is not None
        torch.testing.assert_close(one.evaluate(angles)[0], values[7])

        ntm = model(source, representation)
        fitted = replace(source, mixture=None)
        assert score("affine", ntm, source, representation) < 45
        assert score("affine", ntm, fitted, representation) > score(
            "affine", ntm, source, representation
        )
        latents = score("lstm_latents", ntm, source, representation)
        again = score(
            "lstm_latents", ntm, replace(source, parameters=source.parameters * 0.5), representation
        )
        assert latents == again, "parameters do not enter"

    def test_ages_count_alike_however_few_saw_them(self, representation):
        source = histories(40)
        ntm = model(source, representation)
        observed = source.observed.clone()
        observed[1:, 2:] = False
        few = replace(source, observed=observed)
        ages = []
        for age in (1, 2, 3):
            alone = torch.zeros_like(observed)
            alone[:, age] = observed[:, age]
            ages.append(score("constant", ntm, replace(source, observed=alone), representation))
        assert score("constant", ntm, few, representation) == pytest.approx(sum(ages) / 3)


class TestChoice:
    def choose(self, **scores: tuple[float, ...]) -> str:
        names = ("texels", "above", "below")
        named: dict[str, dict[str, float]] = {
            rung: dict(zip(names, row, strict=False)) for rung, row in scores.items()
        }
        return choose(named, sufficient=45, margin=1)

    def test_what_extrapolates_is_preferred_to_what_interpolates(self):
        chosen = self.choose(
            constant=(10, 10, 10),
            affine=(34, 33, 33),
            lstm_parameters=(38, 25, 28),
            lstm_latents=(37, 24, 28),
        )
        assert chosen == "affine"

    def test_the_cheapest_within_the_margin(self):
        rows = {"constant": (10, 10, 10), "affine": (30, 30, 30), "lstm_latents": (40, 36, 35)}
        assert self.choose(**rows, lstm_parameters=(39, 36, 34)) == "lstm_parameters"
        assert self.choose(**rows, lstm_parameters=(38, 34, 34)) == "lstm_latents"

    def test_enough_is_enough_where_it_is_so_everywhere(self):
        better = {"lstm_parameters": (70, 70, 70), "lstm_latents": (60, 60, 60)}
        assert self.choose(constant=(9, 9, 9), affine=(46, 45, 47), **better) == "affine"
        assert self.choose(constant=(9, 9, 9), affine=(60, 44, 60), **better) == "lstm_parameters"

    def test_rungs_found_unneeded_are_not_compared(self):
        row = {"constant": (9, 9, 9), "affine": (50, 46, 46)}
        assert self.choose(**row, lstm_parameters=(90,), lstm_latents=(80,)) == "affine"
        assert suffices({"texels": 45, "above": 46}, 45)
        assert not suffices({"texels": 90, "above": 44}, 45)


class TestTraining:
    @pytest.mark.parametrize(("n", "frames"), [(1, 2), (2, 2), (3, 5)])
    def test_the_smallest_sources(self, tmp_path, representation, n, frames):
        ntm = train_ladder(
            histories(n, frames, curved=True), representation, TINY, Run(tmp_path / "x")
        )
        assert ntm.chosen in LADDER
        assert ntm.frames == frames
        for scores in ntm.card.details["ladder"].values():
            assert all(0 < psnr <= 100 for psnr in scores.values())

    def test_folds_are_short_and_have_checkpoints_of_their_own(self, tmp_path, representation):
        ntm = train_ladder(histories(80, curved=True), representation, TINY, Run(tmp_path / "x"))
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {
            f"x.{fold}{kind}.checkpoint.safetensors"
            for fold in ("", "above.", "below.")
            for kind in ("parameters", "latents")
        }
        assert ntm.card.details["trained"]["iterations"] == {"parameters": 4, "latents": 4}
        assert ntm.card.details["trained"]["ranges_of"].startswith("ks")

    def test_what_was_trained_whole_is_used_again_with_other_folds(self, tmp_path, representation):
        """How long ranges are trained on says nothing of the LSTMs that are kept."""
        source, run = histories(80, curved=True), Run(tmp_path / "x", resume=True)
        one = train_ladder(source, representation, TINY, run)
        before = (tmp_path / "x.latents.checkpoint.safetensors").stat().st_mtime_ns
        for path in tmp_path.glob("x.*.*.checkpoint.safetensors"):
            path.unlink()
        other = train_ladder(source, representation, replace(TINY, fold_share=0.5), run)
        assert (tmp_path / "x.latents.checkpoint.safetensors").stat().st_mtime_ns == before
        for name, value in one.tensors().items():
            assert torch.equal(value, other.tensors()[name])
