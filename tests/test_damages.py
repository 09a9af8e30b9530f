"""Damaged samples: what each damage does, and how little the bundled encoder suffers from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from model_runtime.brdf.half_angle import cosines
from model_runtime.representation import Trained, build, load_representation
from tests.drawn_materials import drawn
from training.evaluation.representation import damages
from training.metric.sphere import Sphere

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def model() -> Iterator[Trained]:
    with torch.no_grad():
        yield load_representation()[0]


@pytest.fixture(scope="module")
def sphere(data_folder: Path) -> Sphere:
    return Sphere.load(data_folder / "hdri", pixels=16, height=16, width=32)


class TestDamages:
    """The damages are what they say."""

    angles = build("lobes").sample_angles(258)
    f = drawn(5).evaluate(angles)

    def ruined(self, name: str, severity: float) -> torch.Tensor:
        g = torch.Generator().manual_seed(1)
        return damages.DAMAGES[name].ruin(self.angles, self.f, severity, g)

    def test_fewer_samples(self):
        f = self.ruined("samples", 64)
        assert torch.equal(f[:, :64], self.f[:, :64])
        assert bool(f[:, 64:].isnan().all())

    def test_no_grazing_samples(self):
        kept = self.ruined("grazing", 60)[0, :, 0].isfinite()
        cos_i, cos_o, _, _ = cosines(self.angles)
        assert float(torch.minimum(cos_i, cos_o)[kept].min()) >= 0.5 - 1e-6
        assert torch.equal(kept, torch.minimum(cos_i, cos_o) >= 0.5)
        assert 20 < int(kept.sum()) < 200

    def test_noise(self):
        ratio = self.ruined("noise", 5) / self.f
        assert float(ratio.mean()) == pytest.approx(1, abs=0.005)
        assert float(ratio.std()) == pytest.approx(0.05, rel=0.05)

    def test_fireflies(self):
        ratio = (self.ruined("fireflies", 3) / self.f).round()
        assert ratio.eq(100).sum((1, 2)).tolist() == [9] * len(self.f)
        assert bool(((ratio == 1) | (ratio == 100)).all())

    @given(st.floats(0, 1), st.floats(0, 1), st.floats(1e-4, 1))
    def test_eight_bits(self, kd: float, ks: float, alpha: float):
        states = (torch.full((1, 3), kd), torch.full((1, 3), ks), torch.tensor([alpha]))
        coarse = damages.coarse(states, 8)
        by_hand = 12.92 * kd if kd <= 0.0031308 else 1.055 * kd ** (1 / 2.4) - 0.055
        again = float(coarse[0][0, 0])
        again = 12.92 * again if again <= 0.0031308 else 1.055 * again ** (1 / 2.4) - 0.055
        assert again * 255 == pytest.approx(round(again * 255), abs=1e-2)
        assert abs(again - by_hand) < 0.5 / 255 + 1e-5
        assert abs(float(coarse[1][0, 0]) - ks) < 0.5 / 255 + 1e-6
        assert abs(math.sqrt(float(coarse[2])) - math.sqrt(alpha)) < 0.5 / 255 + 1e-6

    def test_an_encoder_without_gaps_reads_a_shorter_list(self):
        torch.manual_seed(0)
        paper = build("paper").eval().requires_grad_(False)
        angles = paper.sample_angles(50)
        f = drawn(5).evaluate(angles)
        shorter = f.clone()
        shorter[:, 20:] = torch.nan
        found = damages.read_what_is_there(paper, angles, shorter)
        assert found is not None
        expected = paper.encode(angles[:20], f[:, :20])
        assert torch.equal(found.flat(), expected.flat())
        f[..., 1] = torch.nan
        assert damages.read_what_is_there(paper, angles, f) is None


@pytest.fixture(scope="module")
def stability(model: Trained, data_folder: Path, sphere: Sphere):
    torch.set_num_threads(1)
    return damages.measure_stability(model, data_folder, sphere)


class TestStability:
    """What damaged input costs, in dB of the mean over materials: the sharper the undamaged
    picture, the more, so that these bounds are for a mean of 45 dB and some margin.
    """

    @pytest.mark.parametrize(
        ("damage", "label", "loss"),
        [
            ("samples", "128", 5.0),
            ("samples", "64", 6.0),
            ("samples", "32", 7.0),
            ("samples", "16", 14.0),
            ("grazing", "80°", 4.0),
            ("grazing", "60°", 11.0),
            ("grazing", "50°", 15.0),
            ("noise", "5 %", 3.0),
            ("noise", "20 %", 9.0),
            ("fireflies", "1", 7.0),
            ("fireflies", "3", 12.0),
            ("fireflies", "10", 20.0),
            ("bad_channel", "missing", 1.5),
            ("bad_channel", "x10", 8.0),
            ("bad_channel", "zero", 17.0),
            ("bits", "8 bit", 6.0),
        ],
    )
    def test_costs_little(self, stability, damage: str, label: str, loss: float):
        curve = stability[damage]
        assert curve["mean"][0] - curve["mean"][curve["labels"].index(label)] < loss

    @pytest.mark.parametrize(
        ("damage", "label", "share"),
        [
            ("samples", "64", 0.3),
            ("grazing", "80°", 0.3),
            ("noise", "5 %", 0.1),
            ("fireflies", "1", 0.2),
            ("bits", "8 bit", 0.05),
        ],
    )
    def test_latents_stay_near(self, stability, damage: str, label: str, share: float):
        """`share` of the median distance between two materials."""
        curve = stability[damage]
        assert curve["displacement"][curve["labels"].index(label)] < share
