"""Pictures of what the bundled NTMs do to real materials: aged by the product itself."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence as Materials
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from model_runtime.age import AgeRequest
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.channels import ALPHA, KD, KS
from model_runtime.contract import AUTO, TORRANCE_SPARROW
from model_runtime.images import write_exr
from model_runtime.model_files.weights import ENCODER, MODELS, find_model
from model_runtime.reading.inputs import hash_file

from ...data.nbrdf import load
from ...data.sequences import Sequence, read_sequence
from ...metric.sphere import tone_map
from ..bench.aging import age_silently, texels_of
from ..bench.charts import bare, pixels_in_place
from ..bench.kept import identity, kept
from ..bench.spheres import SHOWN, TexturedSphere

__all__ = ("FIGURE_10", "GALLERY", "draw_figure_10", "draw_gallery")

MERL = "MERL "

GALLERY: dict[str, tuple[str, str, str, str]] = {
    "rust": ("Metal032", "PaintedMetal004", "PaintedMetal007", "Metal035"),
    "patina": ("Metal035", "MERL gold-metallic-paint3", "MERL two-layer-gold", "Wood049"),
    "char": ("Wood049", "Leather028", "Fabric045", "Metal032"),
    "drying": ("Wood049", "Leather028", "Granite002A", "Metal024"),
    "fading": ("PaintedMetal007", "PaintedWood007B", "MERL orange-paint", "Metal024"),
    "soiling": ("Fabric045", "Plastic005", "MERL white-paint", "Metal035"),
    "yellowing": ("Wood049", "PaintedWood007B", "MERL cherry-235", "Metal032"),
    "moss": ("Wood049", "Leather028", "Fabric045", "Metal032"),
}
"""For each bundled NTM three materials that it fits and, last, one that it does not: folders of
`pbr`, or measured BRDFs of MERL."""

FIGURE_10 = ("Wood049", "Metal035", "MERL steel")
"""What rust is put on in the paper's figure 10: wood, copper and a measured steel."""

_PIXELS = 128
_LIGHT = (16, 32)
_CELL = 1.15


def draw_gallery(data: Path, path: Path, *, folder: Path) -> None:
    """Every bundled NTM on three fitting materials and one unfitting: start, middle and end."""
    sphere = _sphere(data, folder)
    names = [name for name in GALLERY if (MODELS / f"{name}.safetensors").exists()]
    rows = [(name, GALLERY[name]) for name in names]
    _draw(data, rows, 3, sphere, folder, path)


def draw_figure_10(data: Path, path: Path, *, folder: Path) -> None:
    """Rust on wood, copper and steel at five times, whether or not it fits: the domain's fallback
    is overridden, as in the paper's figure 10.
    """
    rows = [("rust", (material,)) for material in FIGURE_10]
    _draw(data, rows, 5, _sphere(data, folder), folder, path, model="lstm_parameters")


def _sphere(data: Path, folder: Path) -> TexturedSphere:
    height, width = _LIGHT
    return TexturedSphere.load(
        data / "hdri", pixels=_PIXELS, stride=1, folder=folder, height=height, width=width
    )


def _draw(
    data: Path,
    rows: Materials[tuple[str, Materials[str]]],
    frames: int,
    sphere: TexturedSphere,
    folder: Path,
    path: Path,
    *,
    model: str = AUTO,
) -> None:
    """A row for each NTM, its materials side by side, `frames` pictures of each."""
    columns = max(len(materials) for _, materials in rows)
    figure = Figure(figsize=(_CELL * frames * columns + 1.2, (_CELL + 0.25) * len(rows)))
    parts = figure.subfigures(len(rows), columns, squeeze=False, wspace=0.02, hspace=0.0)
    place = {"left": 0.01, "right": 0.99, "top": 0.84, "bottom": 0, "wspace": 0.03}
    for line, (name, materials) in zip(parts, rows, strict=True):
        for part, material in zip(line, materials, strict=True):
            pixels, foreign = _aged(data, name, material, frames, sphere, model, folder)
            title = f"{name} on {material}" + (", unlike it: affine change" if foreign else "")
            part.suptitle(title, fontsize=9, y=0.99)
            axes = part.subplots(1, frames, squeeze=False, gridspec_kw=place)
            for ax, some in zip(axes[0], pixels, strict=True):
                bare(ax, pixels_in_place(some, sphere.sphere.inside))
    figure.savefig(path, dpi=80)


def _aged(
    data: Path,
    ntm: str,
    material: str,
    frames: int,
    sphere: TexturedSphere,
    model: str,
    folder: Path,
) -> tuple[Tensor, bool]:
    """Tone-mapped pixels [T, P, 3] of a material over time; whether it is foreign to the NTM."""
    what = f"{ntm}_{material}_{model}_{frames}".replace(" ", "_")
    made_from = identity(hash_file(find_model(ntm)), hash_file(ENCODER), f"{_PIXELS} {_LIGHT}")

    def make() -> dict[str, Tensor]:
        states, foreign = _states(data, ntm, material, frames, model)
        texels = sphere.texels(*states.shape[1:3])
        radiance = sphere.render(states.flatten(1, 2)[:, texels])[:, SHOWN]
        return {"pixels": tone_map(radiance).clamp(0, 1), "foreign": torch.tensor(foreign)}

    found = kept(folder / f"gallery_{what}.safetensors", made_from, make)
    return found["pixels"], bool(found["foreign"])


def _states(data: Path, ntm: str, material: str, frames: int, model: str) -> tuple[Tensor, bool]:
    """States [T, H, W, C] as the product writes them, and whether it found the material foreign."""
    with tempfile.TemporaryDirectory() as folder:
        request = AgeRequest(
            _input(data, material, Path(folder) / "input"),
            ntm,
            Path(folder) / "aged",
            frames=frames,
            size=_PIXELS,
            format=TORRANCE_SPARROW,
            temporal_model=model,
        )
        warnings = age_silently(request)["warnings"]
        sequence = read_sequence(request.output)
    assert isinstance(sequence, Sequence)
    return texels_of(sequence), any("unlike" in warning for warning in warnings)


def _input(data: Path, material: str, folder: Path) -> Path:
    """A folder that `age` reads: one of `pbr`, or maps of a texel with the fit of a MERL BRDF."""
    if not material.startswith(MERL):
        return data / "pbr" / material
    measured = load(data, "merl").select([material.removeprefix(MERL)])
    fit = fit_torrance_sparrow(measured.evaluate(torch.arange(1), fit_angles()))
    state = fit.parameters().numpy()
    folder.mkdir()
    write_exr(folder / "kd.exr", state[None, :, KD])
    write_exr(folder / "ks.exr", state[None, :, KS])
    write_exr(folder / "alpha.exr", state[None, :, ALPHA.start])
    return folder
