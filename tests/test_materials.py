"""Random training materials: physical, repeatable, and damaged as measurements are."""

from __future__ import annotations

import math

import pytest
import torch

from model_runtime.brdf.half_angle import cosines, directions, from_directions
from model_runtime.brdf.torrance_sparrow import specular_lobe
from training.data.materials import _Coat, damage, draw_batch, loss_angles
from training.data.nbrdf import load
from training.distributed import Share

pytestmark = pytest.mark.usefixtures("one_thread")


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def merl(data_folder):
    return load(data_folder, "merl")


def test_a_batch_has_its_size_and_repeats(merl):
    angles = loss_angles(50, generator())
    one, same, other = (
        torch.cat(
            [
                source(angles)
                for source in draw_batch(
                    merl, Share(24), generator(seed), bent=0.7, torrance_sparrow=0.25
                )
            ]
        )
        for seed in (1, 1, 2)
    )
    assert one.shape == (24, len(angles), 3)
    assert torch.equal(one, same)
    assert not torch.equal(one, other)
    assert bool(torch.isfinite(one).all())
    assert float(one.min()) >= 0


def test_light_and_eye_may_be_exchanged(merl):
    angles = loss_angles(60, generator()).double()
    wi, wo = directions(angles)
    forth, back = from_directions(wi, wo).float(), from_directions(wo, wi).float()
    for source in draw_batch(merl, Share(24), generator(4), bent=1.0, torrance_sparrow=0.25):
        torch.testing.assert_close(source(back), source(forth), rtol=5e-3, atol=1e-3)


def test_a_coat_takes_from_what_is_below_what_it_reflects():
    """At normal incidence, off its peak: 1 - F0 of the substrate is left, and nothing else."""
    coat = _Coat(
        coated=torch.tensor([1]),
        alpha=torch.tensor([[0.01, 0.01]]),
        gamma=torch.tensor([[20.0, 20.0]]),
        weight=torch.tensor([[1.0, 0.0]]),
        f0=torch.tensor([[0.04]]),
    )
    off_peak = torch.tensor([[0.6, 0.0, 0.0]])
    f = coat(torch.full((2, 1, 3), 0.2), off_peak)
    assert torch.equal(f[0], torch.full((1, 3), 0.2))
    torch.testing.assert_close(f[1], torch.full((1, 3), 0.2 * 0.96))


def test_a_coat_with_gamma_1_is_torrance_sparrow_s_lobe():
    alpha, angles = 0.3, loss_angles(80, generator())
    coat = _Coat(
        coated=torch.tensor([0]),
        alpha=torch.tensor([[alpha, alpha]]),
        gamma=torch.tensor([[1.0, 1.0]]),
        weight=torch.tensor([[1.0, 0.0]]),
        f0=torch.tensor([[1.0]]),
    )
    f = coat(torch.zeros(1, len(angles), 3), angles)[0, :, 0]
    torch.testing.assert_close(
        f, specular_lobe(torch.tensor([alpha]), angles)[0], rtol=1e-4, atol=0
    )


class TestDamage:
    def materials(self, n: int = 400):
        angles = loss_angles(258, generator())
        return angles, torch.rand(n, len(angles), 3, generator=generator(1)) + 0.1

    def test_none_is_done_where_none_is_wanted(self):
        angles, f = self.materials()
        assert torch.equal(damage(angles, f, 0.0, generator(), Share(len(f))), f)

    def test_a_share_is_damaged_and_every_kind_occurs(self):
        angles, f = self.materials()
        seen = damage(angles, f, 0.5, generator(), Share(len(f)))
        hurt = ~torch.isclose(seen, f, rtol=0, atol=0).flatten(1).all(1)
        assert 0.4 < float(hurt.float().mean()) < 0.55
        lost = seen.isnan()
        one_channel = lost.all(1).sum(1) == 1
        noisy = hurt & ~lost.flatten(1).any(1)
        prefix = (lost[:, -1, 0] & ~lost[:, 0, 0]) & ~one_channel
        assert min(int(one_channel.sum()), int(noisy.sum()), int(prefix.sum())) > 10

    def test_something_is_always_left(self):
        angles, f = self.materials()
        known = (~damage(angles, f, 1.0, generator(), Share(len(f))).isnan()).any(2).sum(1)
        assert int(known.min()) >= 10

    def test_lost_grazing_directions_are_the_grazing_ones(self):
        angles, f = self.materials()
        lost = damage(angles, f, 1.0, generator(), Share(len(f))).isnan().all(2)
        cos_i, cos_o, _, _ = cosines(angles)
        low = torch.minimum(cos_i, cos_o)
        sorted_rows = [
            row
            for row in lost
            if row.any() and float(low[row].max()) <= float(low[~row].min()) and row.sum() > 3
        ]
        assert len(sorted_rows) > 20
        assert all(float(low[row].max()) < math.cos(math.radians(50)) for row in sorted_rows)
