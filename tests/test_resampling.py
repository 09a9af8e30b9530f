"""Maps at another size: means where they shrink, linear and repeating where they grow."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.resampling import any_within, resize


def test_reduction_averages_areas() -> None:
    pixels = np.array([[0, 3, 6, 9, 12, 15]], np.float32)
    assert resize(pixels, (1, 3)).tolist() == [[1.5, 7.5, 13.5]]
    # Six texels on four: each new one covers one and a half.
    np.testing.assert_allclose(
        resize(pixels, (1, 4)), [[(0 + 1.5) / 1.5, (1.5 + 6) / 1.5, (9 + 6) / 1.5, 21 / 1.5]]
    )


def test_enlargement_is_linear_between_centers_and_repeats() -> None:
    found = resize(np.array([[0, 4, 4, 8]], np.float32), (1, 8))
    assert found[0].tolist() == [2, 1, 3, 4, 4, 5, 7, 6]
    assert resize(found.T, (8, 1)).tolist() == found.T.tolist()


@settings(max_examples=50, deadline=None)
@given(*[st.integers(1, 12)] * 2, st.integers(1, 4))
def test_a_texture_that_repeats_does_so_at_every_size(h: int, w: int, larger: int) -> None:
    pixels = np.random.default_rng(h * 13 + w).random((h, w)).astype(np.float32)
    size = h * larger, w * larger
    twice = resize(np.tile(pixels, (2, 2)), (2 * size[0], 2 * size[1]))
    np.testing.assert_allclose(twice, np.tile(resize(pixels, size), (2, 2)), atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(*[st.integers(1, 40)] * 4, st.booleans())
def test_resampling_keeps_range_shape_and_mean(h: int, w: int, nh: int, nw: int, rgb: bool) -> None:
    shape = (h, w, 3) if rgb else (h, w)
    pixels = np.random.default_rng(h * 41 + w).random(shape).astype(np.float32)
    found = resize(pixels, (nh, nw))
    assert found.shape == (nh, nw, *shape[2:])
    assert found.dtype == np.float32
    assert found.min() >= pixels.min() - 1e-6
    assert found.max() <= pixels.max() + 1e-6
    if nh <= h and nw <= w:
        np.testing.assert_allclose(found.mean(), pixels.mean(), rtol=1e-4)
    np.testing.assert_allclose(resize(np.full_like(pixels, 0.7), (nh, nw)), 0.7, rtol=1e-6)


def test_any_within_tells_what_a_texel_holds() -> None:
    marked = np.zeros((4, 6), bool)
    marked[1, 4] = True
    assert any_within(marked, (2, 3)).tolist() == [[False, False, True], [False] * 3]
    np.testing.assert_array_equal(any_within(marked, (8, 12)), np.kron(marked, np.ones((2, 2))))
