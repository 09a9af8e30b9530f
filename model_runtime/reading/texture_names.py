"""Which file of a texture set holds which map, told by its name as artists write it.

`Wood049_1K-JPG_Color.jpg`, `wood_diff_2k.png`, `T_Rock_BaseColor.tif`, `metallic.exr`: a name is
split into words at punctuation and capitals; the last words that name a map decide, and what is
left without resolution and format is the material's name.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, shown
from ..images import EXTENSIONS

__all__ = ("choose_maps", "choose_relief", "points_down")

_TAGS = {
    "base_color": (
        *("basecolor", "basecolour", "albedo", "color", "colour"),
        *("diffusecolor", "col", "diffuse", "diff"),
    ),
    "roughness": ("roughness", "rough", "rgh"),
    "gloss": ("glossiness", "gloss", "smoothness"),
    "metallic": ("metallic", "metalness", "metal", "mtl"),
    "specular": ("speculariorlevel", "specularlevel", "specularity", "specular", "spec"),
    "ior": ("ior",),
    "specular_tint": ("speculartint",),
    "packed": ("arm", "orm", "occlusionroughnessmetallic"),
}
"""The words for each map, the most telling first."""

_RELIEF = {
    "height": ("displacement", "disp", "height", "bump"),
    "normal": ("normal", "norm", "nor", "nrm"),
}
"""Maps of shape, which ageing does not need and learning does."""

_IGNORED = (
    *("ao", "ambientocclusion", "occlusion", "opacity"),
    *("emission", "emissive", "emissioncolor", "emissivecolor", "specularcolor", "coatcolor"),
    *("coatroughness", "clearcoatroughness", "sheencolor", "sheenroughness", "subsurfacecolor"),
    *("preview", "thumbnail", "render"),
)
"""Maps that are not read, and pictures of the material."""

_READ = _TAGS | _RELIEF
_MAP_OF_TAG = {tag: name for name, tags in _READ.items() for tag in tags} | dict.fromkeys(_IGNORED)
_RANK_OF_TAG = {tag: rank for tags in _READ.values() for rank, tag in enumerate(tags)}
_LONGEST_TAG = 3
_EVERYDAY = 6
"""Tags shorter than this are everyday words too (rough, metal, color): they count only at the end
of a name, so that `rough_wood.png` is no roughness."""

_WORD = re.compile(r"(?>[A-Z]+(?![a-z])|[A-Z]?[a-z]+)(?![0-9])")
_RESOLUTION = re.compile(r"(?<![a-z0-9])(\d{1,2}k|\d{3,5}(px)?)(?![a-z0-9])", re.IGNORECASE)
_NOT_A_NAME = re.compile(
    r"(?<![a-z0-9])(jpe?g|png|tiff?|exr|gl|dx|map|s?rgb|raw|linear)(?![a-z0-9])", re.IGNORECASE
)
_DOWNWARD = re.compile(r"(?<![A-Za-z])(dx|DX)(?![a-z])|(?<=[a-z])DX(?![a-z])")
_HINT = "Name the maps like wood_BaseColor.jpg and wood_Roughness.jpg."


@dataclass(frozen=True)
class _Candidate:
    """A file that holds a map: whose, how well its tag fits, and in what resolution."""

    file: str
    map: str
    material: str
    order: tuple[int, int, int, str]


def choose_maps(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """File name of each map found among the file `names` of `folder`.

    Keys are fields of PrincipledMaps, `gloss` for an inverted roughness, or `packed` for occlusion,
    roughness and metallic in one image, which fills in for what has no image of its own. Of
    duplicates the one with the more telling tag wins, then JPEG before PNG, TIFF and EXR, then the
    higher resolution.
    Raises InputError where no base color is found or the folder holds several materials.
    """
    found: dict[str, list[_Candidate]] = defaultdict(list)
    for name in names:
        candidate = _read_name(name)
        if candidate and candidate.map not in _RELIEF:
            found[candidate.map].append(candidate)
    if not found["base_color"]:
        raise InputError(f"{shown(folder)} holds no base color map.", _HINT)

    materials = sorted({candidate.material for candidate in found["base_color"]})
    if len(materials) > 1:
        named = " and ".join(_named(material) for material in materials[:2])
        raise InputError(
            f"{shown(folder)} holds several materials: {named}.", "Give each a folder of its own."
        )
    chosen: dict[str, str] = {}
    for map_name, candidates in found.items():
        own = [candidate for candidate in candidates if candidate.material == materials[0]]
        others = sorted({candidate.material for candidate in candidates})
        if not own and len(others) > 1:
            raise InputError(
                f"{shown(folder)} holds several {map_name.replace('_', ' ')} maps, of "
                f"{_named(others[0])} and {_named(others[1])}, and none of {_named(materials[0])}.",
                "Keep the one that belongs to the material.",
            )
        chosen[map_name] = min(own or candidates, key=lambda candidate: candidate.order).file
    if "roughness" in chosen:
        chosen.pop("gloss", None)
    if "metallic" in chosen and ("roughness" in chosen or "gloss" in chosen):
        chosen.pop("packed", None)
    return chosen


def choose_relief(names: Sequence[str]) -> dict[str, str]:
    """File name of the `height` and the `normal` map among the file `names` of a folder, where
    there are any; normals that point up (GL) go before those that point down (DX).
    """
    found: dict[str, list[_Candidate]] = defaultdict(list)
    for name in names:
        candidate = _read_name(name)
        if candidate and candidate.map in _RELIEF:
            found[candidate.map].append(candidate)
    return {
        name: min(some, key=lambda each: (points_down(each.file), each.order)).file
        for name, some in found.items()
    }


def points_down(name: str) -> bool:
    """Whether the normal map `name` says that its green grows downwards, as DirectX has it."""
    return _DOWNWARD.search(Path(name).stem) is not None


def _named(material: str) -> str:
    return f"'{shown(material)}'" if material else "one without a name"


def _read_name(name: str) -> _Candidate | None:
    """What the file `name` holds, None where it is no map that is needed."""
    path = Path(name)
    extension = path.suffix.lower()
    if extension not in EXTENSIONS or name.startswith("."):
        return None
    words = list(_WORD.finditer(path.stem))
    for last in range(len(words) - 1, -1, -1):
        for first in range(max(0, last - _LONGEST_TAG + 1), last + 1):
            tag = "".join(word.group() for word in words[first : last + 1]).lower()
            if tag not in _MAP_OF_TAG:
                continue
            resolution = _RESOLUTION.search(path.stem)
            before, after = path.stem[: words[first].start()], path.stem[words[last].end() :]
            if len(tag) < _EVERYDAY and re.search(r"[a-z]", _bare(after), re.IGNORECASE):
                continue
            map_name = _MAP_OF_TAG[tag]
            if map_name is None:
                return None
            return _Candidate(
                file=name,
                map=map_name,
                material=f"{_bare(before)} {_bare(after)}".strip(),
                order=(
                    _RANK_OF_TAG[tag],
                    EXTENSIONS.index(extension),
                    -_pixels(resolution.group(1)) if resolution else 0,
                    name,
                ),
            )
    return None


def _bare(name: str) -> str:
    """`name` in lower case without resolution, format and punctuation."""
    name = _NOT_A_NAME.sub(" ", _RESOLUTION.sub(" ", name))
    return " ".join(re.split(r"[\W_]+", name.lower())).strip()


def _pixels(resolution: str) -> int:
    digits = int(re.sub(r"\D", "", resolution))
    return digits * 1024 if resolution.lower().endswith("k") else digits
