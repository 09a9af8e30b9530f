"""Between Blender's images and arrays: float32, linear, row 0 at the top."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...errors import MaterialError
from .passing import discard

__all__ = (
    "image_pixels",
    "in_file",
    "linear_color",
    "luminance",
    "read_data",
    "read_exr",
    "read_exr_texel",
    "require_memory",
    "set_as_data",
    "write_exr",
)

Array = NDArray[np.float32]

# What reading a texel of an image takes, copies included.
_BYTES_PER_TEXEL = 50


def _luminance() -> Array:
    """What Cycles makes of a color that feeds a number: each primary's share, which the OCIO
    configuration tells.
    """
    primaries = (mathutils.Color(row) for row in np.eye(3).tolist())
    shares = np.array([each.from_scene_linear_to_xyz_d65()[1] for each in primaries], np.float32)
    rec709 = np.array((0.2126, 0.7152, 0.0722), np.float32)
    return rec709 if np.allclose(shares, rec709, atol=1e-3) else shares


def require_memory(size: tuple[int, int], bytes_per_texel: int) -> None:
    """Raises `MaterialError` where so many texels would fill the memory, which ends Blender."""
    if not hasattr(os, "sysconf"):  # Windows does not tell
        return
    needed = size[0] * size[1] * bytes_per_texel
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > 0.8 * memory:
        raise MaterialError(
            f"Textures of {size[1]} x {size[0]} px need {needed / 1e9:.0f} GB of memory, and this "
            f"machine has {memory / 1e9:.0f}.",
            "Choose a smaller size, or smaller images.",
        )


def image_pixels(image: bpy.types.Image) -> Array:
    """An image's raw pixels [H, W, 4], in its own color space if it has 8 bits, linear if more."""
    width, height = image.size
    require_memory((height, width), _BYTES_PER_TEXEL)
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1]


def set_as_data(image: bpy.types.Image) -> None:
    """Makes an image numbers that no color management touches, whatever its name for that is."""
    image.colorspace_settings.is_data = True


def linear_color(image: bpy.types.Image, *, alpha_is_used: bool) -> Array | None:
    """An image's linear color [H, W, 3]; None where Cycles mixes its alpha into it, its own way.

    Images of more than 8 bits are linear as soon as they are loaded.
    """
    pixels = image_pixels(image)
    color = np.ascontiguousarray(pixels[..., :3])
    is_data = image.colorspace_settings.is_data
    counts = image.alpha_mode in ("STRAIGHT", "PREMUL") and bool((pixels[..., 3] < 1).any())
    if counts and (image.is_float or image.alpha_mode == "PREMUL"):
        return None
    if image.is_float or is_data:
        return color
    return None if counts and not alpha_is_used else _srgb_to_linear(color)


def in_file(image: bpy.types.Image) -> Array:
    """An image's color [H, W, 3] as its file holds it, or would once it is saved."""
    managed = image.is_float and not image.colorspace_settings.is_data
    if managed and image.source == "FILE" and not image.is_dirty:
        # 16 bits: Blender has made them linear when it loaded them.
        copy = image.copy()
        try:
            set_as_data(copy)
            return np.ascontiguousarray(image_pixels(copy)[..., :3])
        finally:
            discard(copy)
    color = np.ascontiguousarray(image_pixels(image)[..., :3])
    decoded = managed and image.colorspace_settings.name == "sRGB"
    return _linear_to_srgb(color) if decoded else color


def luminance(pixels: Array) -> Array:
    """What counts of a map [H, W, C] where a number is asked for, as in Cycles: [H, W]."""
    gray = pixels.shape[-1] == 1 or (pixels == pixels[..., :1]).all()
    return pixels[..., 0] if gray else pixels @ _luminance()  # gray stays exact


def _srgb_to_linear(color: Array) -> Array:
    """IEC 61966-2-1."""
    high = ((np.maximum(color, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(color <= 0.04045, color / 12.92, high).astype(np.float32)


def _linear_to_srgb(color: Array) -> Array:
    """IEC 61966-2-1."""
    high = 1.055 * np.maximum(color, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(color <= 0.0031308, color * 12.92, high).astype(np.float32)


def write_exr(path: Path, pixels: Array) -> None:
    """Writes a map [H, W], [H, W, 3] or, with alpha, [H, W, 4] as a 32-bit float EXR, by Blender's
    own image code.
    """
    height, width = pixels.shape[:2]
    require_memory((height, width), _BYTES_PER_TEXEL)
    rgba = np.ones((height, width, 4), np.float32)
    alpha = pixels.ndim == 3 and pixels.shape[2] == 4
    rgba[..., : 4 if alpha else 3] = pixels if pixels.ndim == 3 else pixels[..., None]
    image = bpy.data.images.new(
        path.stem, width, height, alpha=alpha, float_buffer=True, is_data=True
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
        discard(image)


def read_exr_texel(path: Path) -> tuple[float, float, float]:
    """The color of the only texel of a 1 x 1 EXR (a number comes as three equal ones)."""
    pixels = read_exr(path)
    if pixels.shape[:2] != (1, 1):
        raise MaterialError(
            f"{path} is not the 1 x 1 map of a uniform material.", "Age the material again."
        )
    red, green, blue = pixels[0, 0].tolist()
    return red, green, blue


def read_exr(path: Path) -> Array:
    """A map [H, W, 3] as its file holds it."""
    return read_data(path)[..., :3].copy()


def read_data(path: Path) -> Array:
    """Numbers [H, W, 4] as a file holds them; bytes are from 0 to 1."""
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        set_as_data(image)
        image.alpha_mode = "CHANNEL_PACKED"
        return image_pixels(image)
    finally:
        discard(image)
