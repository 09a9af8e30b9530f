"""What a run says of what it spared."""

from __future__ import annotations

import pytest

from model_runtime.output.savings import savings


def every(name: str, frames: int = 4) -> list[str]:
    return [f"{name}_{k + 1:04d}.exr" for k in range(frames)]


def between_ends(name: str) -> list[list[list]]:
    first, *_, last = every(name)
    return [
        [[first, 1.0]],
        [[first, 2 / 3], [last, 1 / 3]],
        [[first, 0.5], [last, 0.5]],
        [[last, 1.0]],
    ]


def still(name: str) -> list[list[list]]:
    return [[[every(name)[0], 1.0]]] * 4


@pytest.mark.parametrize(
    ("texels", "modeled", "said"),
    [
        (524_288, 214, "Modeled 214 texels for all 524,288."),
        (524_288, 1, "Modeled 1 texel for all 524,288."),
        (4096, 4096, "Modeled every one of 4,096 texels."),
        (1, 1, "Modeled one texel: the material is the same all over."),
    ],
)
def test_how_much_was_modeled(texels: int, modeled: int, said: str):
    files = {"kd": every("kd"), "alpha": every("alpha")}
    assert savings(texels=texels, modeled=modeled, interval=1, files=files) == [said]


def test_which_frames_were_written():
    files = {
        "base_color": between_ends("base_color"),
        "metallic": still("metallic"),
        "specular": still("specular"),
        "roughness": every("roughness"),
    }
    assert savings(texels=9, modeled=2, interval=1, files=files)[1:] == [
        "Base color: wrote 2 of 4 frames.",
        "Metallic and specular do not change.",
    ]


def test_maps_alike_are_named_together():
    files = {name: between_ends(name) for name in ("kd", "ks", "alpha")}
    assert savings(texels=9, modeled=2, interval=1, files=files)[1:] == [
        "Kd, ks and alpha: wrote 2 of 4 frames each."
    ]
    only = {"kd": still("kd")}
    assert savings(texels=9, modeled=2, interval=1, files=only)[1:] == ["Kd does not change."]


def test_frames_that_are_interpolated():
    files = {"kd": every("kd")}
    assert savings(texels=9, modeled=2, interval=3, files=files)[1:] == [
        "Aged one frame in 3; those between are interpolated."
    ]
