"""Puts the demo's rendered frames side by side, each with its frame and age.

python contact_sheet.py OUTPUT_FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

BAND = 34


def main() -> None:
    folder = Path(sys.argv[1])
    times = json.loads((folder / "aged.json").read_text(encoding="utf-8"))["times"]
    pictures = sorted(folder.glob("frame_*.png"))
    first = Image.open(pictures[0])
    sheet = Image.new("RGB", (first.width * len(pictures), first.height + BAND), (24, 24, 26))
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(size=18)
    for column, picture in enumerate(pictures):
        frame = int(picture.stem.removeprefix("frame_"))
        sheet.paste(Image.open(picture).convert("RGB"), (column * first.width, 0))
        draw.text(
            ((column + 0.5) * first.width, first.height + BAND / 2),
            f"frame {frame}, age {times[frame - 1]:.2f}",
            fill=(235, 235, 235),
            font=font,
            anchor="mm",
        )
    sheet.save(folder / "contact_sheet.png", optimize=True)
    for name in ("aged.blend", "contact_sheet.png", "aged.json"):
        print((folder / name).resolve())


main()
