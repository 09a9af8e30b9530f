"""S1 and S2 of the paper, against values worked out by hand from section 4.3."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from model_runtime.errors import InputError
from model_runtime.maps import TorranceSparrowMaps
from training.data.synthetic import S1_DELTA, from_pbr, offset, s1, s2


def maps(kd=(0.4, 0.5, 0.2), ks=0.5, alpha=0.1) -> TorranceSparrowMaps:
    kd, ks = (np.broadcast_to(np.float32(v), (2, 3, 3)).copy() for v in (kd, ks))
    return TorranceSparrowMaps(kd, ks, np.full((2, 3), alpha, np.float32))


def test_s1_by_hand():
    sequence = s1(maps(), 0.6, frames=3)
    assert sequence.times.tolist() == [0, 0.5, 1]
    # 0.4/1.3^2, 0.15 + 0.5/1.15, 0.2 x 1.5/1.35 + 0.3
    np.testing.assert_allclose(sequence.kd[1, 0, 0], (0.2366864, 0.5847826, 0.5222222), rtol=1e-5)
    # 0.4/1.6^2, 0.6 + 0.5/1.6, 0.2 x 1.5/0.9 + 0.6
    np.testing.assert_allclose(sequence.kd[2, 1, 2], (0.15625, 0.9125, 0.9333333), rtol=1e-5)
    assert (sequence.ks == np.float32(0.5)).all()
    assert (sequence.alpha == np.float32(0.1)).all()
    assert sequence.onset is None


def test_s2_by_hand():
    sequence = s2(maps(), 0.8, frames=3)
    np.testing.assert_allclose(sequence.kd[1, 0, 0], (0.616, 0.48, 0.188), rtol=1e-5)
    np.testing.assert_allclose(sequence.ks[1, 0, 0], 0.38, rtol=1e-5)
    np.testing.assert_allclose(sequence.alpha[1, 0, 0], 0.15, rtol=1e-5)
    np.testing.assert_allclose(sequence.kd[2, 1, 2], (0.832, 0.46, 0.176), rtol=1e-5)
    np.testing.assert_allclose(sequence.ks[2, 1, 2], 0.26, rtol=1e-5)
    np.testing.assert_allclose(sequence.alpha[2, 1, 2], 0.21, rtol=1e-5)


@pytest.mark.parametrize("model", [s1, s2])
def test_they_start_at_the_initial_maps_and_have_36_frames(model):
    initial = maps()
    sequence = model(initial, 1.0)
    assert sequence.alpha.shape == (36, 2, 3)
    np.testing.assert_array_equal(sequence.kd[0], initial.kd)
    np.testing.assert_array_equal(sequence.ks[0], initial.ks)
    np.testing.assert_array_equal(sequence.alpha[0], initial.alpha)


@pytest.mark.parametrize("model", [s1, s2])
def test_they_are_affine_in_the_initial_value(model):
    """Why the simplest model wins on them: the mean of two histories is that of the mean start."""
    dark, light, middle = (model(maps(v, v, v), 0.6) for v in (0.1, 0.5, 0.3))
    for name in ("kd", "ks", "alpha"):
        mean = (getattr(dark, name) + getattr(light, name)) / 2
        np.testing.assert_allclose(getattr(middle, name), mean, rtol=1e-4, atol=1e-6)


def test_values_leave_their_range_until_clamped():
    """Ks falls by 0.3 in S2, so 0.2 ends at -0.1; alpha 0.5 ends at 0.5 x (0.25 + 1 + 1) > 1."""
    sequence = s2(maps(ks=0.2, alpha=0.5), 1.0)
    assert sequence.ks[-1, 0, 0, 0] == pytest.approx(-0.1, abs=1e-6)
    assert sequence.alpha[-1, 0, 0] == pytest.approx(1.125)
    assert not sequence.out_of_range()[0].any()
    assert sequence.out_of_range()[-1].all()

    rendered = sequence.clamped()
    assert (rendered.ks[-1] == 0).all()
    assert (rendered.alpha[-1] == 1).all()
    assert not rendered.out_of_range().any()


def test_the_target_is_offset_and_clamped():
    target = offset(maps(kd=(0.3, 0.05, 0.2), alpha=0.95), delta=S1_DELTA, beta=0.2)
    np.testing.assert_allclose(target.kd[0, 0], (0.4, 0.0, 0.2), rtol=1e-6)
    np.testing.assert_allclose(target.alpha, 1.0)
    np.testing.assert_allclose(target.ks, 0.5)


def test_initial_maps_of_an_ambientcg_material(data_folder):
    patch = (slice(100, 132), slice(200, 248))
    initial = from_pbr(data_folder / "pbr" / "Wood049", patch)
    assert initial.size == (32, 48)

    def texel(name):
        image = Image.open(data_folder / "pbr" / "Wood049" / f"Wood049_1K-JPG_{name}.jpg")
        return np.array(image.convert("RGB").getpixel((200 + 7, 100 + 5))) / 255

    srgb, roughness = texel("Color"), texel("Roughness")[0]
    np.testing.assert_allclose(initial.kd[5, 7], ((srgb + 0.055) / 1.055) ** 2.4, rtol=2e-3)
    np.testing.assert_allclose(initial.ks[5, 7], 0.65 - 0.3 * roughness, atol=2e-3)
    np.testing.assert_allclose(initial.alpha[5, 7], roughness**2, atol=4e-3)


def test_a_patch_outside_the_maps_is_refused(data_folder):
    with pytest.raises(InputError, match="reaches beyond"):
        from_pbr(data_folder / "pbr" / "Wood049", (slice(1000, 1100), slice(0, 100)))


def test_a_folder_without_maps_is_refused(tmp_path):
    with pytest.raises(InputError, match="0 files"):
        from_pbr(tmp_path, (slice(0, 4), slice(0, 4)))
