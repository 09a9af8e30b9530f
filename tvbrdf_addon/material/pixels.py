"""Between Blender's images and arrays: float32, linear, row 0 at the top."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import MaterialError

__all__ = (
    "image_pixels",
    "in_file",
    "linear_color",
    "luminance",
    "read_exr",
    "read_exr_texel",
    "resampled",
    "write_exr",
)

Array = NDArray[np.float32]

LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)
"""Rec.709 luminance: what Cycles makes of a colour that feeds a number."""


def image_pixels(image: bpy.types.Image) -> Array:
    """An image's raw pixels [H, W, 4], in its own colour space if it has 8 bits, linear if more."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1]


def linear_color(image: bpy.types.Image) -> tuple[Array, bool]:
    """An image's linear colour [H, W, 3], and whether its alpha darkens it where Alpha is not used.

    Images of more than 8 bits are linear as soon as they are loaded.
    """
    pixels = image_pixels(image)
    color = np.ascontiguousarray(pixels[..., :3])
    if image.is_float or image.colorspace_settings.name != "sRGB":
        return color, False
    darkens = image.alpha_mode == "STRAIGHT" and bool((pixels[..., 3] < 1).any())
    return _srgb_to_linear(color), darkens


def in_file(image: bpy.types.Image) -> Array:
    """An image's colour [H, W, 3] as its file holds it, or would once it is saved."""
    color = np.ascontiguousarray(image_pixels(image)[..., :3])
    # 16 bits: Blender has made them linear when it loaded them.
    decoded = image.is_float and image.colorspace_settings.name == "sRGB"
    return _linear_to_srgb(color) if decoded else color


def luminance(pixels: Array) -> Array:
    """What counts of a map [H, W, C] where a number is asked for, as in Cycles: [H, W]."""
    grey = pixels.shape[-1] == 1 or (pixels == pixels[..., :1]).all()
    return pixels[..., 0] if grey else pixels @ LUMINANCE  # grey stays exact


def _srgb_to_linear(color: Array) -> Array:
    """IEC 61966-2-1."""
    high = ((np.maximum(color, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(color <= 0.04045, color / 12.92, high).astype(np.float32)


def _linear_to_srgb(color: Array) -> Array:
    """IEC 61966-2-1."""
    high = 1.055 * np.maximum(color, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(color <= 0.0031308, color * 12.92, high).astype(np.float32)


def resampled(pixels: Array, size: tuple[int, int]) -> Array:
    """The map at another size (height, width).

    Larger it is bilinear between texel centres, tiling; smaller it is the mean over each texel.
    """
    for axis, length in enumerate(size):
        if length > pixels.shape[axis]:
            pixels = _stretched(pixels, axis, length)
        elif length < pixels.shape[axis]:
            pixels = _averaged(pixels, axis, length)
    return pixels


def _stretched(pixels: Array, axis: int, length: int) -> Array:
    old = pixels.shape[axis]
    at = (np.arange(length, dtype=np.float64) + 0.5) * old / length - 0.5
    low = np.floor(at).astype(int)
    weight = (at - low).astype(np.float32).reshape(_along(pixels, axis, length))
    first, second = (np.take(pixels, (low + i) % old, axis=axis) for i in (0, 1))
    return first * (1 - weight) + second * weight


def _averaged(pixels: Array, axis: int, length: int) -> Array:
    old = pixels.shape[axis]
    ends = np.arange(length + 1) * old / length
    whole = np.minimum(ends.astype(int), old - 1)
    part = (ends - whole).reshape(_along(pixels, axis, length + 1))
    # The integral from the border to each end: all texels before it, and the part of its own.
    total = np.cumsum(pixels, axis=axis, dtype=np.float64) - pixels
    integral = np.take(total, whole, axis=axis) + part * np.take(pixels, whole, axis=axis)
    return (np.diff(integral, axis=axis) * (length / old)).astype(np.float32)


def _along(pixels: Array, axis: int, length: int) -> list[int]:
    return [length if each == axis else 1 for each in range(pixels.ndim)]


def write_exr(path: Path, pixels: Array) -> None:
    """Writes a map [H, W] or [H, W, 3] as a 32-bit float EXR, by Blender's own image code."""
    height, width = pixels.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels if pixels.ndim == 3 else pixels[..., None]
    image = bpy.data.images.new(
        path.stem, width, height, alpha=False, float_buffer=True, is_data=True
    )
    try:
        image.pixels.foreach_set(rgba[::-1].ravel())
        image.filepath_raw = str(path)
        image.file_format = "OPEN_EXR"
        image.save()
    except RuntimeError as error:
        raise MaterialError(
            f"{path} cannot be written ({str(error).strip()}).",
            "Choose a folder that can be written to, with room left on its disk.",
        ) from error
    finally:
        bpy.data.images.remove(image)


def read_exr_texel(path: Path) -> tuple[float, float, float]:
    """The colour of the only texel of a 1 x 1 EXR (a number comes as three equal ones)."""
    pixels = read_exr(path)
    if pixels.shape[:2] != (1, 1):
        raise MaterialError(
            f"{path} is not the 1 x 1 map of a uniform material.", "Age the material again."
        )
    red, green, blue = pixels[0, 0].tolist()
    return red, green, blue


def read_exr(path: Path) -> Array:
    """A map [H, W, 3] as its file holds it."""
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        return image_pixels(image)[..., :3].copy()
    finally:
        bpy.data.images.remove(image)
