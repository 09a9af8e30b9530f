"""The panel as artists have it, photographed in a real Blender with a window.

    python panels.py PICTURE

At three widths, in two themes, before and after aging, and on a 4K screen at half its size
(`tests/blender/windowed_panels.py`).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.blender.windowed import HERE, run_in_window  # noqa: E402

USUAL, LARGE = "1200x1300", "3840x2160"
FRESH = [f"Blender_{theme}_{px}_fresh" for theme in ("Dark", "Light") for px in (200, 280, 420)]
AGED = [f"Blender_{each}_aged" for each in ("Dark_200", "Light_280", "Dark_420", "Light_420")]
AGED_LARGE = "Blender_Dark_280_aged"
HIGH, GAP = (360, 900), 12  # px
MOST = 400_000  # bytes


def photographs(screen: str) -> dict[str, Image.Image]:
    """Those of one screen, by name."""
    with tempfile.TemporaryDirectory() as place:
        run_in_window(
            HERE / "windowed_panels.py", Path(place), seconds=600, screen=screen, worker=True
        )
        found = Path(place).glob("Blender_*.png")
        return {path.stem: Image.open(path).convert("RGB") for path in found}


def row(pictures: list[Image.Image], high: int) -> Image.Image:
    """Pictures side by side, of which the upper `high` pixels are shown."""
    wide = sum(each.width + GAP for each in pictures) - GAP
    whole, x = Image.new("RGB", (wide, high)), 0
    for each in pictures:
        whole.paste(each, (x, 0))
        x += each.width + GAP
    return whole


def main() -> None:
    target = Path(sys.argv[1])
    usual, large = photographs(USUAL), photographs(LARGE)
    above = row([usual[each] for each in FRESH], HIGH[0])
    below = row([*(usual[each] for each in AGED), large[AGED_LARGE].reduce(2)], HIGH[1])
    wide = max(above.width, below.width)
    whole = Image.new("RGB", (wide, sum(HIGH) + GAP))
    whole.paste(above, (0, 0))
    whole.paste(below, (0, HIGH[0] + GAP))
    whole.save(target, quality=80, optimize=True)
    size = target.stat().st_size
    assert size <= MOST, f"{target} has {size} bytes"
    print(f"{target}: {size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
