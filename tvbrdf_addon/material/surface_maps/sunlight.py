"""The light of a year under the open sky, as a picture of the sky around. NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ("light_of_a_year",)

Array = NDArray[np.float32]

_HEIGHT, _WIDTH = 64, 128
_DAYS, _HOURS = np.arange(1, 366, 5), np.arange(0, 24, 1 / 6)
_TILT = 23.45  # degrees by which the earth's axis leans
# Of what falls on the level ground in a year, the share that comes from all over the sky and not
# from the sun: about half in temperate climates.
_DIFFUSE = 0.5


def light_of_a_year(latitude: float, north: float = 0.0) -> Array:
    """Radiance [64, 128] of the sky summed over a year, its mean over the sphere 1, at a `latitude`
    in radians, positive in the north; `north` is the direction of north in the world, in radians
    from +Y counterclockwise.

    Rows go from straight below to straight above, columns as Cycles looks an equirectangular
    picture up. The sun's path follows its declination (Cooper 1969), its strength what the air
    lets through (Meinel and Meinel 1976; air mass of Kasten and Young 1989).
    """
    declination = np.radians(_TILT) * np.sin(2 * np.pi * (284 + _DAYS[:, None]) / 365)
    hour = np.radians(15) * (_HOURS - 12)
    up = np.sin(latitude) * np.sin(declination)
    up = up + np.cos(latitude) * np.cos(declination) * np.cos(hour)
    east = -np.cos(declination) * np.sin(hour)
    to_north = np.cos(latitude) * np.sin(declination)
    to_north = to_north - np.sin(latitude) * np.cos(declination) * np.cos(hour)
    elevation = np.degrees(np.arcsin(up.clip(0, 1)))
    air = 1 / (up.clip(1e-3) + 0.50572 * (elevation + 6.07995) ** -1.6364)
    beam = np.where(up > 0, 0.7 ** (air**0.678), 0)

    x = east * np.cos(north) - to_north * np.sin(north)
    y = east * np.sin(north) + to_north * np.cos(north)
    height = (np.arange(_HEIGHT) + 0.5) / _HEIGHT * np.pi - np.pi / 2
    solid = np.cos(height) * (np.pi / _HEIGHT) * (2 * np.pi / _WIDTH)
    row = ((np.arcsin(up.clip(-1, 1)) / np.pi + 0.5) * _HEIGHT).astype(int).clip(0, _HEIGHT - 1)
    column = ((0.5 - np.arctan2(y, x) / (2 * np.pi)) * _WIDTH).astype(int) % _WIDTH
    sun = np.zeros((_HEIGHT, _WIDTH))
    np.add.at(sun, (row, column), beam)
    sun /= solid[:, None]

    level = np.maximum(np.sin(height), 0) * solid
    sky = np.where(height > 0, 1.0, 0.0)[:, None] * np.ones(_WIDTH)
    sun *= (1 - _DIFFUSE) / (sun * level[:, None]).sum()
    sky *= _DIFFUSE / (sky * level[:, None]).sum()
    both = sun + sky
    return (both / (both * solid[:, None]).sum() * 4 * np.pi).astype(np.float32)
