"""OCIO configurations: those that Blender ships, and one in which nothing has its usual name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).with_name("read_in_configuration.py")
CODES = np.array((188, 64, 20)) / 255
LINEAR = ((CODES + 0.055) / 1.055) ** 2.4  # IEC 61966-2-1

# Here sRGB is a plain power, and data and scene colors have names that no program knows.
ODD = """\
ocio_profile_version: 2
roles: {scene_linear: light, default: light, default_float: light, data: bits, default_byte: screen,
  color_picking: screen, texture_paint: screen, matte_paint: screen, default_sequencer: screen}
displays:
  Screen:
    - !<View> {name: Plain, colorspace: screen}
colorspaces:
  - !<ColorSpace> {name: light, encoding: scene-linear}
  - !<ColorSpace> {name: bits, isdata: true, encoding: data}
  - !<ColorSpace>
    name: screen
    to_scene_reference: !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}
  - !<ColorSpace>
    name: sRGB
    to_scene_reference: !<ExponentTransform> {value: 1.8}
"""


def read_in(configuration: str, folder: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The maps that are read, and what Cycles shows of the color."""
    run = subprocess.run(
        [sys.executable, str(SCRIPT), str(folder)],
        env={**os.environ, "OCIO": configuration, "PYTHONPATH": str(SCRIPT.parents[2])},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    lines = [line for line in run.stdout.splitlines() if line.startswith('{"maps"')]
    assert len(lines) == 1, run.stdout[-2000:] + run.stderr[-2000:]
    said = json.loads(lines[0])
    return {name: np.array(value) for name, value in said["maps"].items()}, np.array(said["shown"])


@pytest.mark.parametrize(
    "configuration",
    [
        "ocio://default",
        "ocio://cg-config-v2.1.0_aces-v1.3_ocio-v2.3",
        "ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3",
    ],
)
def test_images_are_read_as_cycles_shows_them(configuration, tmp_path):
    maps, shown = read_in(configuration, tmp_path)
    np.testing.assert_allclose(maps["BaseColor"], shown, rtol=2e-3)
    np.testing.assert_allclose(maps["Roughness"], 100 / 255, atol=1e-6)
    # Luminance is the same whatever the primaries are.
    luminance = LINEAR @ (0.2126, 0.7152, 0.0722)
    np.testing.assert_allclose(maps["Metallic"], luminance, rtol=3e-3)


def test_a_configuration_without_any_usual_name(tmp_path):
    file = tmp_path / "odd.ocio"
    file.write_text(ODD)
    maps, shown = read_in(str(file), tmp_path)
    np.testing.assert_allclose(maps["BaseColor"], shown, rtol=2e-3)
    np.testing.assert_allclose(maps["BaseColor"], LINEAR, rtol=2e-3)
    np.testing.assert_allclose(maps["Roughness"], 100 / 255, atol=1e-6)
