"""Charts of what a scan was taken for: its two kinds, their border, its curves and their spread."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.errors import OutputError, reason, shown

from .change import Change
from .scan import AGES, Scan
from .scan_maps import HEIGHT, ROUGHNESS

__all__ = ("write_charts",)

Array = NDArray[np.float32]

_CURVES = (
    ("color (kd + ks)", ("tab:red", "tab:green", "tab:blue")),
    ("roughness", ("tab:gray",)),
    ("height, texels", ("tab:brown",)),
)


def write_charts(scan: Scan, change: Change, folder: Path) -> None:
    """`clusters.png`, `border.png` and `curves.png` in `folder`; OutputError where they cannot be
    written. Needs matplotlib.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _clusters(scan, folder / "clusters.png")
        _border(scan, folder / "border.png")
        _curves(scan, change, folder / "curves.png")
    except OSError as error:
        raise OutputError(
            f"The report cannot be written to {shown(folder)} ({reason(error)}).",
            "Choose a folder that can be written.",
        ) from error


def _clusters(scan: Scan, file: Path) -> None:
    """Texels by the two features in which the kinds differ most."""
    from matplotlib import pyplot as plt

    points, weathered = scan.states.sampled
    names = ("lightness", "green to red", "blue to yellow", "roughness", "metalness")
    apart = np.abs(points[weathered].mean(0) - points[~weathered].mean(0))
    x, y = np.argsort(apart)[::-1][:2]
    figure, axes = plt.subplots(figsize=(6, 5))
    for some, color, label in (
        (~weathered, "tab:blue", "clean"),
        (weathered, "tab:red", "weathered"),
    ):
        axes.scatter(points[some, x], points[some, y], 1, color, label=label, alpha=0.3)
    axes.set(xlabel=names[x], ylabel=names[y], title=f"{scan.maps.name}: {scan.states.told}")
    axes.legend(markerscale=8)
    figure.savefig(file, dpi=120, bbox_inches="tight")
    plt.close(figure)


def _border(scan: Scan, file: Path) -> None:
    """The scan beside what was taken for its border."""
    from matplotlib import pyplot as plt

    values = scan.maps.values
    color = np.clip(values[..., :3] + values[..., 3:6], 0, 1) ** (1 / 2.2)
    figure, axes = plt.subplots(1, 2, figsize=(12, 6))
    axes[0].imshow(color)
    axes[0].contour(scan.states.weathered, [0.5], colors="white", linewidths=0.5)
    axes[1].imshow(scan.distance, cmap="RdBu_r", vmin=-40, vmax=40)
    axes[1].set_title("distance from the border, texels")
    for each in axes:
        each.set_axis_off()
    figure.savefig(file, dpi=120, bbox_inches="tight")
    plt.close(figure)


def _curves(scan: Scan, change: Change, file: Path) -> None:
    """Means and spread by distance, and the ages that distances stand for."""
    from matplotlib import pyplot as plt

    curves = scan.curves
    shown_values = (
        (curves.mean[:, :3] + curves.mean[:, 3:6], curves.spread[:, :3]),
        (curves.mean[:, ROUGHNESS, None], curves.spread[:, ROUGHNESS, None]),
        (curves.mean[:, HEIGHT, None], curves.spread[:, HEIGHT, None]),
    )
    figure, axes = plt.subplots(1, 4, figsize=(18, 4))
    for (title, colors), (mean, spread), each in zip(_CURVES, shown_values, axes, strict=False):
        for k, color in enumerate(colors):
            low, high = mean[:, k] - spread[:, k], mean[:, k] + spread[:, k]
            each.fill_between(curves.distance, low, high, color=color, alpha=0.15)
            each.plot(curves.distance, mean[:, k], color=color)
        each.axvline(curves.first, color="black", linewidth=0.5)
        each.axvline(curves.last, color="black", linewidth=0.5)
        each.set(title=title, xlabel="distance, texels", xlim=(-60, 60))
    ages = np.linspace(0, 1, AGES, dtype=np.float32)
    axes[3].plot(ages, change.gone, label="gone")
    axes[3].plot(ages, change.strength, label="grain")
    axes[3].set(title="by local age", xlabel="age")
    axes[3].legend()
    figure.savefig(file, dpi=120, bbox_inches="tight")
    plt.close(figure)
