"""Measured BRDFs of the MERL database (Matusik et al., SIGGRAPH 2003), `.binary` files.

Three int32 (90, 90, 180) are followed by float64 [3][90][90][180]: channel, theta_h, theta_d and
phi_d. Rows lie at theta_h = (i / 90)^2 pi / 2, theta_d = j / 90 pi / 2, phi_d = k / 180 pi; phi_d
has period pi (reciprocity). A negative entry marks a pair of directions that was not measured.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..backend import Tensor, torch
from ..errors import InputError, OutputError, reason, shown
from .half_angle import above_horizon
from .measured import BRIGHTEST, MeasuredBRDF

__all__ = ("GRID", "grid_angles", "read", "write")

GRID = (90, 90, 180)
_SCALE = np.array([1 / 1500, 1.15 / 1500, 1.66 / 1500])
_CELLS = math.prod(GRID)
_BYTES = 12 + 8 * 3 * _CELLS
_HINT = "Use a .binary file of the MERL database as it was published."


def grid_angles() -> Tensor:
    """Half-angle coordinates of every entry of the table: [90, 90, 180, 3], float64."""
    theta_h, theta_d, phi_d = (torch.arange(n, dtype=torch.float64) / n for n in GRID)
    axes = (theta_h.square() * (math.pi / 2), theta_d * (math.pi / 2), phi_d * math.pi)
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)


def read(path: str | Path) -> MeasuredBRDF:
    """Read a MERL `.binary`.

    Raises InputError where the file is missing, cut short, of another grid, or holds NaN or values
    that no material has.
    """
    path = Path(path)
    table = torch.from_numpy(_read_table(path))
    return MeasuredBRDF(name=path.stem, evaluate=lambda angles: _interpolate(table, angles))


def write(path: str | Path, table: np.ndarray) -> None:
    """Write `table` [90, 90, 180, 3], f per steradian, negative where not measured.

    Raises OutputError where the file cannot be written.
    """
    assert table.shape == (*GRID, 3), table.shape
    stored = np.where(table < 0, -1.0, table / _SCALE)
    content = np.asarray(GRID, "<i4").tobytes() + np.moveaxis(stored, -1, 0).astype("<f8").tobytes()
    try:
        Path(path).write_bytes(content)
    except OSError as error:
        raise OutputError(
            f"{shown(path)} cannot be written: {reason(error)}.",
            "Choose a folder that can be written to.",
        ) from error


def _read_table(path: Path) -> np.ndarray:
    """f [90, 90, 180, 3] float32, negative where not measured."""
    name = shown(path.name)
    try:
        size = path.stat().st_size
        if size < 12:
            raise InputError(f"{name} is cut short.", _HINT)
        with path.open("rb") as file:
            grid = tuple(np.frombuffer(file.read(12), "<i4").tolist())
            if grid != GRID:
                raise InputError(
                    f"{name} holds a grid of {' x '.join(map(str, grid))}, "
                    f"where MERL files hold 90 x 90 x 180.",
                    _HINT,
                )
            if size != _BYTES:
                raise InputError(f"{name} has {size} bytes, where a MERL file has {_BYTES}.", _HINT)
            content = file.read(_BYTES - 12)
    except OSError as error:
        raise InputError(f"{name} cannot be read: {reason(error)}.", _HINT) from error
    stored = np.frombuffer(content, "<f8").reshape(3, *GRID)
    with np.errstate(over="ignore"):
        table = (np.moveaxis(stored, 0, -1) * _SCALE).astype(np.float32)
    broken = table.size - int(np.count_nonzero(np.isfinite(table)))
    if broken:
        raise InputError(f"{name} holds {broken} values that are NaN or infinite.", _HINT)
    if table.max() > BRIGHTEST:
        raise InputError(f"{name} holds values that no material has, up to {table.max():g}.", _HINT)
    if (table < 0).any(-1).all():
        raise InputError(f"{name} holds no measured value.", _HINT)
    return np.ascontiguousarray(table)


def _interpolate(table: Tensor, angles: Tensor) -> Tensor:
    """f [M, 3] of angles [M, 3], trilinear over the measured ones of the eight entries around.

    Along theta_h the interpolation is linear in the table's index, which follows its square root.
    Beyond the last row of theta_h and theta_d that row is repeated.
    """
    theta_h, theta_d, phi_d = angles.double().unbind(-1)
    rows_h, rows_d, rows_p = GRID
    places = (
        (theta_h.clamp_min(0) * (2 / math.pi)).sqrt().mul(rows_h).clamp_max(rows_h - 1),
        (theta_d.clamp_min(0) * (2 / math.pi)).mul(rows_d).clamp_max(rows_d - 1),
        torch.remainder(phi_d, math.pi) * (rows_p / math.pi),
    )
    lower = [place.floor().long() for place in places]
    fraction = [place - low for place, low in zip(places, lower, strict=True)]

    total = torch.zeros(len(angles), 3, dtype=torch.float64)
    weight = torch.zeros(len(angles), 1, dtype=torch.float64)
    for corner in range(8):
        steps = [(corner >> axis) & 1 for axis in range(3)]
        share = torch.ones_like(theta_h)
        for step, part in zip(steps, fraction, strict=True):
            share = share * (part if step else 1 - part)
        entry = table[
            (lower[0] + steps[0]).clamp_max(rows_h - 1),
            (lower[1] + steps[1]).clamp_max(rows_d - 1),
            (lower[2] + steps[2]) % rows_p,
        ].double()
        share = torch.where((entry >= 0).all(-1), share, 0)[:, None]
        total += share * entry
        weight += share
    f = total / weight.clamp_min(torch.finfo(torch.float64).tiny)
    return torch.where(above_horizon(angles.double())[:, None], f, 0).to(angles.dtype)
