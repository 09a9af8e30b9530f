"""States: named channels, one layout, and what is done to all of them alike."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import torch

from model_runtime.channels import (
    ALPHA,
    CHANNELS,
    KD,
    KS,
    NAMES,
    REFLECTANCES,
    WIDTH,
    clip_planes,
    optics,
)
from model_runtime.maps import TorranceSparrowMaps
from model_runtime.states import clamped, joined, perceptual, with_reflectances, with_roughness


def states(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, WIDTH, generator=torch.Generator().manual_seed(0))


def test_the_channels_fill_a_state_without_gaps_and_in_order():
    places = [place for channel in CHANNELS.values() for place in range(WIDTH)[channel.place]]
    assert places == list(range(WIDTH))
    assert [NAMES[place].split("_")[0] for place in places] == [
        name for name, channel in CHANNELS.items() for _ in range(WIDTH)[channel.place]
    ]
    assert (NAMES[KD], NAMES[ALPHA]) == (("kd_r", "kd_g", "kd_b"), ("alpha",))


def test_parts_make_the_whole_again():
    given = states(2, 3)
    kd, ks, alpha = optics(given)
    assert (kd.shape, ks.shape, alpha.shape) == ((2, 3, 3), (2, 3, 3), (2, 3))
    assert torch.equal(joined(kd, ks, alpha), given)
    assert torch.equal(with_reflectances(given, given[..., REFLECTANCES]), given)


def test_numbers_out_of_range_are_brought_to_it():
    wild = torch.tensor([[-1.0, 0.5, 2, -0.1, 0, 3, 0], [0, 0, 0, 0, 0, 0, 7.0]])
    least = float(np.float32(1e-4))
    inside = [[0, 0.5, 2, 0, 0, 3, least], [0, 0, 0, 0, 0, 0, 1]]
    assert clamped(wild).tolist() == inside
    assert clamped(states(2, 3)).shape == (2, 3, WIDTH)
    planes = wild.T.numpy().copy()
    clip_planes(planes)
    assert planes.T.tolist() == inside


def test_where_roughness_is_shown_its_range_is_that_of_alpha():
    darkest = torch.zeros(1, WIDTH)
    planes = darkest.T.numpy().copy()
    clip_planes(planes, roughness=True)
    torch.testing.assert_close(torch.from_numpy(planes.T), with_roughness(clamped(darkest)))


def test_only_alpha_becomes_roughness():
    given = states(4)
    shown = with_roughness(given)
    assert torch.equal(shown[:, REFLECTANCES], given[:, REFLECTANCES])
    assert torch.equal(shown[:, ALPHA], given[:, ALPHA].sqrt())


def test_perception_is_a_square_root_between_its_limits():
    seen = perceptual(torch.tensor([-1.0, 0.25, 4, 9]))
    assert seen.tolist() == [0, 0.5, 2, 2]
    assert perceptual(torch.tensor([0.0, 9]), least=0.01, most=math.inf).tolist() == [
        torch.tensor(0.01).sqrt().item(),
        3,
    ]


def test_maps_are_views_of_planes_and_planes_are_made_of_maps():
    planes = states(6).T.numpy()
    maps = TorranceSparrowMaps.of(planes, (2, 3))
    assert all(np.shares_memory(pixels, planes) for pixels in (maps.kd, maps.ks, maps.alpha))
    np.testing.assert_array_equal(maps.planes(), planes)
    np.testing.assert_array_equal(maps.ks[1, 2], planes[KS, 5])


def test_blender_needs_no_torch_for_them():
    code = (
        "import sys, model_runtime.channels, model_runtime.maps; assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
