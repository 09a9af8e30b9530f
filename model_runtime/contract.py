"""What the worker, its command line, the add-on, the tests' stand-ins and evaluation agree on.

What is called how in requests, in messages, in files and on the screen stands here and nowhere
else; nothing is computed. Standard library only, for Blender's own Python imports it too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

__all__ = (
    "AFFINE",
    "AUTO",
    "BACKEND",
    "BALANCED",
    "BINDINGS",
    "CACHE",
    "CACHE_GIGABYTES",
    "CACHE_GIGABYTES_OPTION",
    "CACHE_OPTION",
    "CACHE_SECONDS",
    "CHOICES",
    "COEFFICIENTS_A_FILE",
    "CONSTANT",
    "CPU",
    "CURVES",
    "DEVICES",
    "DRAFT",
    "EARLIER",
    "EVERYWHERE",
    "EXACT",
    "EXPOSURES",
    "FARTHEST_START",
    "FORMATS",
    "FRAMES",
    "HEIGHT",
    "IDLE_MINUTES",
    "IDLE_OPTION",
    "LADDER",
    "LIVE",
    "LOBES",
    "LONGEST_PATTERN",
    "LOOKS",
    "LSTM_LATENTS",
    "LSTM_PARAMETERS",
    "METERS",
    "MOST_DB",
    "NEEDS_TORCH",
    "NUMPY",
    "OF_TEXTURE",
    "PRINCIPLED",
    "PRINCIPLED_EXACT",
    "PROTOCOL",
    "QUALITIES",
    "RANGES",
    "REPORT",
    "RUNGS",
    "SERVE",
    "SHORTEST_PATTERN",
    "SPECULARS",
    "STAGES",
    "TIMING",
    "TORCH",
    "TORRANCE_SPARROW",
    "AgeRequest",
    "Binding",
    "Format",
    "Quality",
    "Specular",
    "Stage",
    "Told",
    "check_exposure",
    "coefficients_file",
    "exposure_weights",
    "frame_file",
    "is_device",
    "is_result_file",
    "option",
    "staging_places",
    "start_places",
)

PROTOCOL = 1
"""The version of the worker's messages (`messages`, docs/worker-protocol.md)."""

SERVE = "serve"
IDLE_OPTION = "--idle-minutes"
IDLE_MINUTES = 10.0
"""How long a worker waits for a next run unless `SERVE` is given another time."""

CACHE: Final = "TVBRDF_CACHE"
"""The environment variable that names a folder for results that are kept (`output.kept`)."""

CACHE_OPTION, CACHE_GIGABYTES_OPTION = "--cache", "--cache-gb"
CACHE_GIGABYTES = 2.0
"""How much of them is kept unless another number is given; nothing at 0."""

CACHE_SECONDS: Final = "cache_seconds"
"""In `aged.json` of a result that was kept: what it took to put it in its place."""


class Told(NamedTuple):
    """How a choice is told to people: its title, and what it means."""

    title: str
    meaning: str


AUTO: Final = "auto"
"""Of several settings: let the run choose."""

# How much of the material is modeled.
DRAFT: Final = "draft"
BALANCED: Final = "balanced"
EXACT: Final = "exact"
Quality = Literal["draft", "balanced", "exact"]
QUALITIES: Mapping[str, Told] = {
    DRAFT: Told("Draft", "A quick look, not checked: few distinct places are modeled"),
    BALANCED: Told("Balanced", "Models as little as the tolerance allows, and checks that it does"),
    EXACT: Told(
        "Exact",
        "Models every texel with every sample and leaves nothing out: for comparisons. Can take "
        "hours; the estimate above the button says so before you start",
    ),
}

# The ladder of models of change.
CONSTANT: Final = "constant"
AFFINE: Final = "affine"
LSTM_PARAMETERS: Final = "lstm_parameters"
LSTM_LATENTS: Final = "lstm_latents"
RUNGS: Mapping[str, Told] = {
    CONSTANT: Told("Constant", "Nothing changes: what the other models are held against"),
    AFFINE: Told("Scale and Offset", "Every channel is scaled and moved over time"),
    LSTM_PARAMETERS: Told("Network", "Learned: how color, highlights and roughness change"),
    LSTM_LATENTS: Told(
        "Network on Reflectance", "Learned on the whole reflectance: slowest by far"
    ),
}
LADDER = (*RUNGS,)
"""Cheapest first; the last works on latents, the others on parameters."""

Specular = Literal["rgb", "mono"]
SPECULARS: Mapping[str, Told] = {
    "rgb": Told("Colored", "Highlights may take on a color, as metals do"),
    "mono": Told("Gray", "Highlights stay gray"),
}

# What a result is: files that a shader sums up, or those of every frame.
LIVE: Final = "live"
FRAMES: Final = "frames"
Binding = Literal["live", "frames"]
BINDINGS: Mapping[str, Told] = {
    LIVE: Told(
        "Live",
        "The shader ages your own nodes at any age: small files, no reloading, and an age of its "
        "own for every object that has a property Age",
    ),
    FRAMES: Told(
        "Frames",
        "Image sequences, which other programs and exporters understand: larger, and slower to "
        "play",
    ),
}

# What a result's maps, or its live sum, drive.
TORRANCE_SPARROW: Final = "torrance-sparrow"
PRINCIPLED: Final = "principled"
PRINCIPLED_EXACT: Final = "principled-exact"
Format = Literal["torrance-sparrow", "principled", "principled-exact"]
FORMATS: Mapping[str, Mapping[str, int]] = {
    TORRANCE_SPARROW: {"kd": 3, "ks": 3, "alpha": 1},
    PRINCIPLED: {"base_color": 3, "metallic": 1, "specular": 1, "roughness": 1},
    PRINCIPLED_EXACT: {"base_color": 3, "specular_tint": 3, "roughness": 1},
}
"""The maps of each format, in order, and how many channels each has."""

HEIGHT: Final = "height"
"""The map of heights, beside those of any format, where these change."""

METERS: Final = "meters"
OF_TEXTURE: Final = "texture"
"""In what `aged.json` tells the side of the grain's tile: a share of the textures' longer side."""

EVERYWHERE: Final = "none"
"""The onset with which every texel starts to age at once."""


# What it means where an artist's mask is white.
MaskMeaning = Literal["first", "only", "never"]
MASK_MEANINGS: Mapping[str, Told] = {
    "first": Told("Starts First", "What is white starts first, and aging spreads from there"),
    "only": Told("Ages Alone", "Only what is white ages: what is black never does"),
    "never": Told("Never Ages", "What is white stays as it is, and what is gray starts later"),
}


@dataclass(frozen=True)
class AgeRequest:
    """What to age, how and where to: the options of the command line (docs/design.md)."""

    input: Path
    ntm: str
    output: Path
    frames: int = 36
    size: int | None = None
    quality: Quality = BALANCED
    tolerance: float = 45.0
    temporal_model: str = AUTO
    onset: str = AUTO
    specular: Specular = "rgb"
    format: Format | None = None
    binding: Binding | Literal["auto"] = FRAMES
    sparse: bool = False
    seed: int = 0
    device: str = AUTO
    surface: Path | None = None
    timing_apart: bool = False
    exposure: str | None = None
    pattern_size: float | None = None
    amount: float = 1.0
    starts: str | None = None
    mask: Path | None = None
    mask_means: MaskMeaning = "first"
    light: Path | None = None
    grain: float = 1.0


CHOICES: Mapping[str, tuple[str, ...]] = {
    "quality": (*QUALITIES,),
    "temporal_model": (AUTO, *RUNGS),
    "specular": (*SPECULARS,),
    "format": (*FORMATS,),
    "binding": (AUTO, *BINDINGS),
    "mask_means": (*MASK_MEANINGS,),
}
"""What those fields of `AgeRequest` may be that are one of a few."""

RANGES: Mapping[str, tuple[int, int]] = {
    "frames": (1, 9999),  # files are numbered with four digits
    "size": (1, 16_384),  # as images may have
    "seed": (0, 2**63 - 1),
}
"""What its whole numbers may be."""

MOST_DB = 1000
"""What its tolerance may be at most; it is more than 0."""

SHORTEST_PATTERN, LONGEST_PATTERN = 1e-6, 1e6
"""What its pattern size may be, in meters."""


FARTHEST_START = 1e7
"""How far, in meters along each axis, a place where it starts may lie from the world's origin."""


EXPOSURES: Mapping[str, Told] = {
    "edges": Told("Edges", "What sticks out"),
    "crevices": Told("Crevices", "What is sheltered from all sides"),
    "sky": Told("Sky", "What the sky sees"),
    "ground": Told("Ground", "What is low"),
    "runs": Told("Runs", "What water brings down from where it starts"),
    "wear": Told("Wear", "What is weathered already"),
    "pattern": Told("Pattern", "How much chance has a say, 0 to 1"),
}
"""Where on an object a process starts; weights from -1, avoided, to 1, sought."""


def check_exposure(weights: Mapping[str, Any]) -> None:
    """Raises ValueError, saying what is wrong, for what is no weight of an exposure."""
    for name, weight in weights.items():
        if name not in EXPOSURES:
            raise ValueError(f"{name} is none of {', '.join(EXPOSURES)}")
        least = 0 if name == "pattern" else -1
        if type(weight) not in (int, float) or not least <= weight <= 1:
            raise ValueError(f"the weight of {name} is not a number from {least} to 1")


def exposure_weights(text: str) -> dict[str, float]:
    """The weights of a request's exposure, `NAME=WEIGHT,...`; ValueError for anything else."""
    weights: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        name, _, number = part.strip().partition("=")
        try:
            weights[name] = float(number)
        except ValueError:
            raise ValueError(f"{part.strip()} is not like edges=0.5") from None
    check_exposure(weights)
    return weights


def start_places(text: str) -> list[tuple[float, float, float]]:
    """The places, in meters of the world, of a request's starts, `X,Y,Z;...`; ValueError for
    anything else.
    """
    found = []
    for part in filter(None, map(str.strip, text.split(";"))):
        try:
            x, y, z = map(float, part.split(","))
        except ValueError:
            raise ValueError(f"{part} is not like 0.5,-1,2") from None
        if not all(abs(each) <= FARTHEST_START for each in (x, y, z)):  # NaN included
            raise ValueError(f"{part} is too far away")
        found.append((x, y, z))
    return found


BACKEND: Final = "TVBRDF_BACKEND"
"""The environment variable that chooses what computes."""

TORCH: Final = "torch"
NUMPY: Final = "numpy"

NEEDS_TORCH = (
    "Learning needs PyTorch, which the small zip of this extension leaves out.",
    "Install the large zip, or choose a Worker Python that has torch in the preferences.",
)
"""Why nothing is learned, and what to do."""

CPU: Final = "cpu"
DEVICES = f"{AUTO}|{CPU}|cuda|cuda:N"
"""What its device may be, for people."""


def is_device(name: str) -> bool:
    """Whether a device may be called so; there need not be one."""
    return re.fullmatch(rf"{AUTO}|{CPU}|cuda(:\d{{1,3}})?", name) is not None


def option(field: str) -> str:
    """The command line's name of a field of `AgeRequest`."""
    return "--" + field.replace("_", "-")


Stage = Literal["read", "onset", "model", "fit", "write"]
LOOKS: Mapping[str, tuple[float, float, float]] = {
    "front.png": (-0.6, -1.0, 0.55),
    "back.png": (0.6, 1.0, 0.55),
}
"""The pictures of a look at where aging starts, and the directions that they are seen from."""

STAGES: Mapping[Stage, str] = {
    "read": "reading",
    "onset": "reading",
    "model": "modeling the change",
    "fit": "finding what texels share",
    "write": "writing",
}
"""What a run does one after the other (`seconds` of the report), and how its progress says it."""

REPORT = "aged.json"
"""The report that makes a folder a result (docs/aged-json.md); all others are what it lists."""

CURVES = "curves.exr"
LOBES = "lobes.exr"
TIMING = "timing.exr"
COEFFICIENTS_A_FILE = 4
"""Coefficients of a live material that share an image, one in each of its channels."""

_RESULT_FILE = re.compile(
    r"[a-z_]+_[0-9]{4,}\.exr|coefficients_[0-9]+\.(?:png|exr)|"
    + "|".join(map(re.escape, (TIMING, CURVES, LOBES)))
)


def frame_file(map_name: str, k: int) -> str:
    """The file of a map in frame `k`, counted from 0."""
    return f"{map_name}_{k + 1:04d}.exr"


def coefficients_file(number: int) -> str:
    """A file of coefficients of a live material, counted from 0."""
    return f"coefficients_{number}.png"


def is_result_file(name: str) -> bool:
    """Whether a file is named as those of results are, the report apart."""
    return _RESULT_FILE.fullmatch(name) is not None


def staging_places(folder: Path, token: str) -> tuple[Path, Path]:
    """Where a result for `folder` may be staged: beside it, or within; `token` has 8 characters."""
    return (
        folder.parent / f".{folder.name}.partial-{token}",
        folder / f".aged.partial-{token}",
    )


EARLIER = ".aged.earlier"
"""What an earlier result is called, in the staging folder, while the new one takes its place."""
