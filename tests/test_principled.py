"""The two mappings between Torrance-Sparrow and Principled: promises of docs/design.md."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from model_runtime.brdf import principled
from model_runtime.maps import Pixels, PrincipledMaps, TorranceSparrowMaps

SOCKETS = ("base_color", "metallic", "specular", "roughness")

unit = st.floats(0, 1, width=32)
color = st.tuples(unit, unit, unit)
tints = st.one_of(st.just((1.0, 1.0, 1.0)), color, st.just((0.0, 0.0, 0.0)))
metals = st.one_of(unit, st.sampled_from([0.0, 1.0, 0.001, 0.999]))
colors = st.one_of(color, unit.map(lambda gray: (gray,) * 3), st.just((1.0, 1.0, 1.0)))
iors = st.one_of(st.floats(1, 3, width=32), st.sampled_from([1.0, 1.5, 17.94]))


def material(
    base: ArrayLike,
    metallic: ArrayLike,
    specular: ArrayLike = 0.5,
    roughness: ArrayLike = 0.5,
    ior: ArrayLike = 1.5,
    tint: ArrayLike = (1.0, 1.0, 1.0),
) -> PrincipledMaps:
    """A PrincipledMaps of one texel, or of as many as the arguments have rows."""
    base = np.atleast_2d(np.asarray(base, np.float32))[None]

    def scalar(value: ArrayLike) -> Pixels:
        return np.broadcast_to(np.asarray(value, np.float32), base.shape[:2]).copy()

    return PrincipledMaps(
        base_color=base,
        metallic=scalar(metallic),
        specular=scalar(specular),
        roughness=scalar(roughness),
        ior=scalar(ior),
        specular_tint=np.broadcast_to(np.asarray(tint, np.float32), base.shape).copy(),
    )


def random_materials(count: int, seed: int, metallic: float | None = None) -> PrincipledMaps:
    rng = np.random.default_rng(seed)
    return material(
        rng.random((count, 3)),
        rng.random(count) if metallic is None else metallic,
        rng.random(count),
        rng.random(count),
        rng.uniform(1, 2.5, count),
    )


def assert_same(one, other) -> None:
    for field in fields(one):
        np.testing.assert_array_equal(
            getattr(one, field.name), getattr(other, field.name), err_msg=field.name
        )


def assert_within_a_percent(found: TorranceSparrowMaps, wanted: TorranceSparrowMaps) -> None:
    # 1e-6 is what float32 leaves of sums near 1.
    np.testing.assert_allclose(found.kd, wanted.kd, rtol=0.01, atol=1e-6)
    np.testing.assert_allclose(found.ks, wanted.ks, rtol=0.01, atol=1e-6)
    np.testing.assert_allclose(found.alpha, wanted.alpha, rtol=0.01, atol=1e-6)


def assert_in_range(found: PrincipledMaps, authored: PrincipledMaps) -> None:
    for name in SOCKETS:
        value, before = getattr(found, name), getattr(authored, name)
        assert np.isfinite(value).all(), name
        assert (value >= 0).all(), name
        assert (value <= np.maximum(before, 1)).all(), name


def test_forward_is_the_formula_of_the_design() -> None:
    # Plastic: n = 1.5 gives F0 = 0.04 at level 0.5; half metal mixes; IOR 1 has no F0.
    maps = material(
        [(0.8, 0.4, 0.2)] * 3, [0.0, 0.5, 0.0], [0.5, 1.0, 1.0], [0.5, 0.2, 1.0], [1.5, 1.5, 1.0]
    )
    found = principled.forward(maps)
    np.testing.assert_allclose(found.kd[0], [(0.8, 0.4, 0.2), (0.4, 0.2, 0.1), (0.8, 0.4, 0.2)])
    np.testing.assert_allclose(
        found.ks[0], [(0.04,) * 3, (0.44, 0.24, 0.14), (0.0,) * 3], rtol=1e-6
    )
    np.testing.assert_allclose(found.alpha[0], [0.25, 0.04, 1.0], rtol=1e-6)


@settings(max_examples=300, deadline=None)
@given(colors, metals, st.floats(0, 2, width=32), unit, iors, tints)
def test_no_change_gives_the_authored_maps_back_to_the_bit(
    base, metallic, level, rough, ior, tint
) -> None:
    authored = material(base, metallic, level, rough, ior, tint)
    assert_same(principled.read_back(principled.forward(authored), authored), authored)


@settings(max_examples=1000, deadline=None)
@given(colors, metals, unit, unit, colors, metals, unit, unit, iors, tints)
def test_whatever_principled_can_represent_is_met_within_a_percent(
    base, metallic, level, rough, new_base, new_metallic, new_level, new_rough, ior, tint
) -> None:
    authored = material(base, metallic, level, rough, ior, tint)
    aged = principled.forward(material(new_base, new_metallic, new_level, new_rough, ior, tint))
    found = principled.read_back(aged, authored)
    assert_in_range(found, authored)
    assert_within_a_percent(principled.forward(found), aged)
    assert_same(replace(found, **{name: getattr(authored, name) for name in SOCKETS}), authored)


@pytest.mark.parametrize("before", [None, 0.0, 1.0])
@pytest.mark.parametrize("after", [None, 0.0, 1.0, 0.999])
@pytest.mark.parametrize("gray", [False, True])
def test_many_materials_are_met_within_a_percent(before, after, gray: bool) -> None:
    authored = random_materials(100_000, 1, before)
    aged_material = replace(random_materials(100_000, 2, after), ior=authored.ior)
    if gray:
        flat = np.repeat(aged_material.base_color[..., :1], 3, -1)
        aged_material = replace(aged_material, base_color=flat)
    aged = principled.forward(aged_material)
    found = principled.read_back(aged, authored)
    assert_in_range(found, authored)
    assert_within_a_percent(principled.forward(found), aged)


def test_where_color_tells_the_metallic_it_is_found() -> None:
    # Copper turned to green patina, and painted plastic worn to steel-blue metal: one answer only.
    authored = material([(0.9, 0.5, 0.3), (0.1, 0.4, 0.1)], [1.0, 0.0])
    aged_material = material([(0.2, 0.5, 0.4), (0.5, 0.6, 0.7)], [0.0, 1.0], [0.3, 0.5], 0.7)
    found = principled.read_back(principled.forward(aged_material), authored)
    np.testing.assert_allclose(found.metallic, [[0.0, 1.0]], atol=1e-3)
    np.testing.assert_allclose(found.base_color, aged_material.base_color, rtol=1e-3)
    assert found.specular[0, 0] == pytest.approx(0.3, rel=1e-2)
    np.testing.assert_allclose(found.roughness, 0.7, rtol=1e-6)


def test_where_color_is_silent_the_authored_metallic_stays() -> None:
    authored = material([(0.5, 0.5, 0.5)] * 2, [0.05, 0.0])
    darker = principled.forward(material([(0.4, 0.4, 0.4)] * 2, [0.05, 0.0]))
    found = principled.read_back(darker, authored)
    np.testing.assert_allclose(found.metallic, authored.metallic, atol=1e-6)
    np.testing.assert_allclose(found.specular, 0.5, rtol=1e-4)


def test_full_rust_does_not_show_what_lay_under_it() -> None:
    rust = principled.forward(material([(0.25, 0.1, 0.04)] * 3, 0.0, 0.5, 0.9))
    under = material([(0.9, 0.9, 0.95), (0.1, 0.2, 0.9), (0.0, 0.0, 0.0)], [1.0, 0.0, 0.5])
    found = principled.read_back(rust, under)
    np.testing.assert_allclose(found.base_color[0], [(0.25, 0.1, 0.04)] * 3, rtol=1e-3)
    np.testing.assert_allclose(found.metallic, 0, atol=1e-4)


def test_a_small_change_moves_the_sockets_a_little() -> None:
    authored = random_materials(20_000, 3)
    aged = principled.forward(authored)
    nudged = replace(aged, kd=aged.kd * np.float32(1 + 1e-4))
    found = principled.read_back(nudged, authored)
    assert np.quantile(np.abs(found.base_color - authored.base_color), 0.99) < 5e-3
    assert np.quantile(np.abs(found.metallic - authored.metallic), 0.99) < 5e-3


@settings(max_examples=500, deadline=None)
@given(
    st.tuples(*[st.floats(0, 1e4, width=32)] * 3),
    st.tuples(*[st.floats(0, 1e4, width=32)] * 3),
    st.floats(0, 1e4, width=32),
    colors,
    metals,
    st.floats(0, 4, width=32),
    iors,
    tints,
)
def test_anything_else_stays_finite_and_in_range(
    kd, ks, alpha, base, metallic, level, ior, tint
) -> None:
    authored = material(base, metallic, level, 0.5, ior, tint)
    aged = TorranceSparrowMaps(
        np.array([[kd]], np.float32), np.array([[ks]], np.float32), np.array([[alpha]], np.float32)
    )
    assert_in_range(principled.read_back(aged, authored), authored)
    base_color, tint_map, roughness = principled.exact(aged)
    for value in (base_color, tint_map, roughness):
        assert ((value >= 0) & (value <= 1)).all()


@pytest.mark.parametrize("gray", [0.0, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("level", [0.7, 0.9, 1.0])
def test_what_no_metal_can_reflect_becomes_a_dielectric(level: float, gray: float) -> None:
    # F0 above 1, as high an IOR as 17.94 gives: more than a base color of 1 does.
    authored = material([(1.0, 1.0, 1.0)], 1.0, 0.0, ior=17.94)
    aged = principled.forward(material([(gray,) * 3], 0.0, level, ior=17.94))
    found = principled.read_back(aged, authored)
    assert_within_a_percent(principled.forward(found), aged)


def test_a_tint_too_weak_to_be_a_float_limits_nothing() -> None:
    tint = (0.0, 1.0, 1.2e-43)
    authored = material([(1.0, 1.0, 1.0)], 0.0, 0.0, 0.0, 2.0, tint)
    aged = principled.forward(material([(1.0, 1.0, 1.0)], 0.0, 0.5, 0.0, 2.0, tint))
    assert_within_a_percent(principled.forward(principled.read_back(aged, authored)), aged)


def test_a_level_authored_above_one_may_stay() -> None:
    authored = material([(0.3, 0.2, 0.1)], 0.0, 1.8)
    aged = principled.forward(material([(0.25, 0.2, 0.1)], 0.0, 1.7))
    found = principled.read_back(aged, authored)
    assert found.specular[0, 0] == pytest.approx(1.7, rel=1e-3)
    assert_within_a_percent(principled.forward(found), aged)


def test_result_does_not_depend_on_neighbors() -> None:
    authored, aged = random_materials(30_001, 4), principled.forward(random_materials(30_001, 5))
    whole = principled.read_back(aged, authored)
    part = slice(17_003, 17_010)

    def cut(maps):
        return type(maps)(*(getattr(maps, field.name)[:, part] for field in fields(maps)))

    assert_same(principled.read_back(cut(aged), cut(authored)), cut(whole))


def test_exact_mapping_is_inverted_by_its_formulae() -> None:
    rng = np.random.default_rng(6)
    ks = rng.uniform(0, 0.8, (8, 8, 3)).astype(np.float32)
    kd = (rng.random((8, 8, 3)) * (1 - ks.max(-1, keepdims=True))).astype(np.float32)
    alpha = rng.uniform(1e-4, 1, (8, 8)).astype(np.float32)
    aged = TorranceSparrowMaps(kd, ks, alpha)
    assert principled.representable(aged)
    base_color, tint, roughness = principled.exact(aged)
    np.testing.assert_allclose(0.8 * tint, ks, rtol=1e-6)
    np.testing.assert_allclose(base_color * (1 - ks.max(-1, keepdims=True)), kd, rtol=1e-5)
    np.testing.assert_allclose(roughness**2, alpha, rtol=1e-6)


@pytest.mark.parametrize(
    ("kd", "ks", "fits"),
    [
        ((0.0, 0.0, 0.0), (0.8, 0.8, 0.8), True),
        ((0.0, 0.0, 0.0), (0.81, 0.5, 0.3), False),
        ((0.5, 0.2, 0.2), (0.2, 0.5, 0.2), True),
        ((0.51, 0.2, 0.2), (0.2, 0.5, 0.2), False),
    ],
)
def test_exact_mapping_has_limits(kd, ks, fits: bool) -> None:
    aged = TorranceSparrowMaps(
        np.array([[kd]], np.float32), np.array([[ks]], np.float32), np.ones((1, 1), np.float32)
    )
    assert principled.representable(aged) is fits
