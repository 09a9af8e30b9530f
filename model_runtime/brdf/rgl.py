"""Isotropic RGB `.bsdf` files of the RGL material database (Dupuy and Jakob, SIGGRAPH Asia 2018).

A `.bsdf` is a *tensor file*: named arrays behind a table of their types, offsets and shapes. The
measurement is stored on a grid that the material's own distribution of visible normals has warped,
so that highlights get most of the samples; evaluating undoes the warp (`invert` in the authors'
code).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..backend import Tensor, functional, torch
from ..errors import InputError, reason, shown
from .half_angle import directions
from .measured import BRIGHTEST, MeasuredBRDF

__all__ = ("read",)

_MAGIC = b"tensor_file\0"
_HEADER = len(_MAGIC) + 2 + 4
_DTYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8"} | {
    9: "<f2",
    10: "<f4",
    11: "<f8",
}
_HINT = "Use an isotropic RGB file of the RGL database (its name ends in _rgb.bsdf)."
_MAX_BYTES = 256 << 20
_MAX_FIELDS = 64
_MAX_RANK = 8
_MAX_GRID = 4096
_MAX_CELLS = 1 << 22  # of a field: 25 times those of the database
_LARGEST = 1e12  # of any number in a field
_MAX_THETA = 1.6  # radians, a bit beyond the horizon


def read(path: str | Path) -> MeasuredBRDF:
    """Read an isotropic RGB `.bsdf`.

    Raises InputError where the file is missing, damaged, anisotropic or spectral; so does what it
    returns where the fields together make values that no material has.
    """
    path = Path(path)
    name = shown(path.name)
    material = _material(name, _read_tensors(path))

    def evaluate(angles: Tensor) -> Tensor:
        f = material.evaluate(angles)
        if not bool((f <= BRIGHTEST).all()):  # nor NaN
            raise InputError(f"{name} holds values that no material has.", _HINT)
        return f

    return MeasuredBRDF(name=path.stem, evaluate=evaluate)


@dataclass(frozen=True)
class _Warp:
    """Visible-normal densities per incident elevation and their running integrals.

    density, conditional: [I, V, U]; marginal: [I, V]. Each slice integrates to 1 over grid cells
    (trapezoid rule); u, the last axis, is the normal's elevation, v its azimuth.
    """

    density: Tensor
    conditional: Tensor
    marginal: Tensor

    @staticmethod
    def of(density: Tensor) -> _Warp:
        cells = (density[..., 1:] + density[..., :-1]) / 2
        conditional = functional.pad(cells.cumsum(-1), (1, 0))
        rows = conditional[..., -1]
        marginal = functional.pad(((rows[:, 1:] + rows[:, :-1]) / 2).cumsum(-1), (1, 0))
        total = marginal[:, -1]
        return _Warp(
            density / total[:, None, None],
            conditional / total[:, None, None],
            marginal / total[:, None],
        )

    def invert(self, u: Tensor, v: Tensor, slices: _Slices) -> tuple[Tensor, Tensor]:
        """The uniform sample [M], [M] that the warp takes to (u, v)."""
        i, j, x, y = _cell(u, v, self.density.shape)
        last = torch.full_like(i, self.density.shape[-1] - 1)

        def across_rows(table: Tensor, column: Tensor) -> Tensor:
            return torch.lerp(slices.at(table, j, column), slices.at(table, j + 1, column), y)

        left, right = across_rows(self.density, i), across_rows(self.density, i + 1)
        along_u = across_rows(self.conditional, i) + x * (left + x * (right - left) / 2)
        row = across_rows(self.conditional, last)
        first = slices.at(self.conditional, j, last)
        second = slices.at(self.conditional, j + 1, last)
        along_v = slices.at(self.marginal, j) + y * (first + y * (second - first) / 2)
        return along_u / row.clamp_min(torch.finfo(row.dtype).tiny), along_v


@dataclass(frozen=True)
class _Slices:
    """The two measured incident elevations around each direction: lower index [M], weight [M]."""

    lower: Tensor
    weight: Tensor

    @staticmethod
    def around(theta_i: Tensor, measured: Tensor) -> _Slices:
        lower = (torch.searchsorted(measured, theta_i, right=True) - 1).clamp(0, len(measured) - 2)
        span = measured[lower + 1] - measured[lower]
        return _Slices(lower, ((theta_i - measured[lower]) / span).clamp(0, 1))

    def at(self, table: Tensor, *index: Tensor) -> Tensor:
        low, high = table[(self.lower, *index)], table[(self.lower + 1, *index)]
        return torch.lerp(low, high, self.weight.reshape(-1, *[1] * (low.dim() - 1)))


@dataclass(frozen=True)
class _Material:
    """theta_i [I]; sigma, ndf [V, U]; rgb [I, V, U, 3]; all float64, for the sums lose digits."""

    theta_i: Tensor
    sigma: Tensor
    ndf: Tensor
    warp: _Warp
    rgb: Tensor

    def evaluate(self, angles: Tensor) -> Tensor:
        """f [M, 3] of angles [M, 3]: f cos_o = max(0, rgb(s)) ndf(u_m) / (4 sigma(u_i))."""
        wi, wo = directions(angles.double())
        cos_i, cos_o = wi[:, 2], wo[:, 2]
        theta_m = angles[:, 0].double()
        theta_i = torch.atan2(torch.hypot(wi[:, 0], wi[:, 1]), cos_i)
        phi_i = torch.atan2(wi[:, 1], wi[:, 0])
        # phi_h is 0, so that the half vector's azimuth relative to wi is -phi_i.
        azimuth = (math.pi - phi_i) / (2 * math.pi)
        u, v = _square(theta_m), azimuth - azimuth.floor()
        slices = _Slices.around(theta_i, self.theta_i)

        s_u, s_v = self.warp.invert(u, v, slices)
        i, j, x, y = _cell(s_u, s_v, self.rgb.shape[:3])
        x, y = x[:, None], y[:, None]
        upper = torch.lerp(slices.at(self.rgb, j, i), slices.at(self.rgb, j, i + 1), x)
        lower = torch.lerp(slices.at(self.rgb, j + 1, i), slices.at(self.rgb, j + 1, i + 1), x)
        reflectance = torch.lerp(upper, lower, y).clamp_min(0)

        projected = _bilinear(self.sigma, _square(theta_i), (phi_i + math.pi) / (2 * math.pi))
        jacobian = _bilinear(self.ndf, u, v) / (4 * projected)
        seen = (cos_i > 0) & (cos_o > 0)
        f = reflectance * (jacobian / torch.where(seen, cos_o, 1))[:, None]
        return torch.where(seen[:, None], f, 0).to(angles.dtype)


def _square(theta: Tensor) -> Tensor:
    """Elevations 0 to pi/2 on the unit interval, denser around the normal."""
    return (theta * (2 / math.pi)).clamp(0, 1).sqrt()


def _cell(u: Tensor, v: Tensor, shape: torch.Size) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Column and row of the grid cell that holds (u, v), and the place within it, each [M]."""
    columns, rows = u.clamp(0, 1) * (shape[-1] - 1), v.clamp(0, 1) * (shape[-2] - 1)
    i, j = columns.long().clamp_max(shape[-1] - 2), rows.long().clamp_max(shape[-2] - 2)
    return i, j, columns - i, rows - j


def _bilinear(image: Tensor, u: Tensor, v: Tensor) -> Tensor:
    i, j, x, y = _cell(u, v, image.shape)
    upper = torch.lerp(image[j, i], image[j, i + 1], x)
    return torch.lerp(upper, torch.lerp(image[j + 1, i], image[j + 1, i + 1], x), y)


def _material(name: str, tensors: dict[str, np.ndarray]) -> _Material:
    """Check shapes and values against what an isotropic RGB measurement must be."""
    if "rgb" not in tensors and {"spectra", "wavelengths"} & set(tensors):
        raise InputError(f"{name} is a spectral measurement, which is not supported.", _HINT)
    missing = {"phi_i", "theta_i", "sigma", "ndf", "vndf", "rgb"} - set(tensors)
    if missing:
        raise InputError(f"{name} lacks the fields {', '.join(sorted(missing))}.", _HINT)
    if tensors["phi_i"].size > 2:
        raise InputError(f"{name} is anisotropic, which is not supported.", _HINT)

    theta_i = tensors["theta_i"]
    slices = theta_i.size
    ranks = {"theta_i": 1, "sigma": 2, "ndf": 2, "vndf": 4, "rgb": 5}
    for field, rank in ranks.items():
        tensor = tensors[field]
        if tensor.dtype != np.dtype("<f4") or tensor.ndim != rank:
            raise InputError(f"The field {field} of {name} has a wrong type or shape.", _HINT)
        if rank > 1 and not all(2 <= n <= _MAX_GRID for n in tensor.shape[-2:]):
            raise InputError(f"The field {field} of {name} has an unusable grid.", _HINT)
        if tensor.size > _MAX_CELLS:
            raise InputError(f"The field {field} of {name} is larger than any of RGL.", _HINT)
        if not np.isfinite(tensor).all():
            raise InputError(f"The field {field} of {name} holds NaN or infinite values.", _HINT)
        if (np.abs(tensor) > _LARGEST).any():
            raise InputError(f"The field {field} of {name} holds numbers without sense.", _HINT)
    if (
        slices < 2
        or tensors["vndf"].shape[:2] != (1, slices)
        or tensors["rgb"].shape[:3] != (1, slices, 3)
        or (np.diff(theta_i) <= 0).any()
        or not 0 <= theta_i[0] <= theta_i[-1] <= _MAX_THETA
    ):
        raise InputError(f"The fields of {name} do not fit together.", _HINT)
    vndf, sigma = tensors["vndf"][0], tensors["sigma"]
    if (vndf < 0).any() or (vndf.sum((1, 2)) <= 0).any() or (sigma <= 0).any():
        raise InputError(f"The distribution of normals in {name} is not one.", _HINT)

    def double(array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float64))

    return _Material(
        theta_i=double(theta_i),
        sigma=double(sigma),
        ndf=double(tensors["ndf"]),
        warp=_Warp.of(double(vndf)),
        rgb=double(tensors["rgb"][0].transpose(0, 2, 3, 1)),
    )


def _read_tensors(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a tensor file by name; InputError where any points outside the file."""
    name = shown(path.name)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{name} is larger than any RGL measurement.", _HINT)
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{name} cannot be read: {reason(error)}.", _HINT) from error
    if not content.startswith(_MAGIC):
        raise InputError(f"{name} is not a .bsdf tensor file.", _HINT)
    try:
        return dict(_fields(content))
    except (struct.error, ValueError) as error:
        raise InputError(f"{name} is damaged or cut short.", _HINT) from error


def _fields(content: bytes):
    """Yield (name, array) of each field; struct.error or ValueError where the table lies."""
    major, _minor, count = struct.unpack_from("<BBI", content, len(_MAGIC))
    if major != 1 or count > _MAX_FIELDS:
        raise ValueError("unknown version or too many fields")
    at = _HEADER
    for _ in range(count):
        (length,) = struct.unpack_from("<H", content, at)
        name = content[at + 2 : at + 2 + length].decode("utf-8")
        at += 2 + length
        rank, kind, offset = struct.unpack_from("<HBQ", content, at)
        if rank > _MAX_RANK or kind not in _DTYPES:
            raise ValueError("unknown type or rank")
        shape = struct.unpack_from(f"<{rank}Q", content, at + 11)
        at += 11 + 8 * rank
        dtype, size = np.dtype(_DTYPES[kind]), math.prod(shape)
        if offset + size * dtype.itemsize > len(content):
            raise ValueError("a field lies outside the file")
        yield name, np.frombuffer(content, dtype, size, offset).reshape(shape)
