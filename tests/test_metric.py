"""The metric: a sphere under real light, as docs/design.md pins it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.errors import InputError
from training.evaluation.representation.evaluate import evaluate_representation
from training.evaluation.representation.sets import UNIFORM
from training.metric.radiance import read_radiance
from training.metric.sphere import MAPS, Sphere, psnr, tone_map


@pytest.fixture(scope="module")
def hdri(data_folder: Path) -> Path:
    return data_folder / "hdri"


def test_tone_map_is_the_paper_s():
    values = np.array([0.0, 0.1, 1.0, 30.0])
    expected = (1 - np.exp(-2 * values)) ** (1 / 2.8)
    np.testing.assert_allclose(tone_map(torch.tensor(values)), expected, rtol=1e-12)


def test_psnr_of_a_known_error_and_its_cap():
    truth = torch.zeros(2, 5, 3, dtype=torch.float64)
    radiance = -0.5 * np.log(1 - 0.1**2.8)  # tone-maps to a tenth
    estimate = truth.clone()
    estimate[0] = radiance
    np.testing.assert_allclose(psnr(truth, estimate), [20.0, 100.0], atol=1e-6)


def test_a_white_sphere_shows_the_irradiance_of_the_map(hdri: Path):
    """The pixel that faces the viewer sees the half space behind the camera, added up here anew."""
    sphere = Sphere.load(hdri, pixels=33)
    white = sphere.render(lambda angles: torch.full((1, len(angles), 3), 1 / np.pi))[0]
    middle = white.shape[1] // 2
    for index, name in enumerate(MAPS):
        image = read_radiance(hdri / f"{name}_1k.hdr")
        rows, columns = image.shape[:2]
        image = image.reshape(32, rows // 32, 64, columns // 64, 3).mean((1, 3))
        polar = (np.arange(32) + 0.5) * np.pi / 32
        turn = (np.arange(64) + 0.5) * 2 * np.pi / 64
        solid = np.sin(polar)[:, None] * (np.pi / 32) * (2 * np.pi / 64)
        mean = (image * solid[..., None]).sum() / (3 * solid.sum() * 64)
        towards_viewer = -np.sin(polar)[:, None] * np.cos(turn)
        lit = np.clip(towards_viewer, 0, None)[..., None] * solid[..., None] * image
        np.testing.assert_allclose(white[index, middle], lit.sum((0, 1)) / mean / np.pi, rtol=1e-4)


def test_light_from_below_a_pixel_s_horizon_does_not_count(hdri: Path):
    sphere = Sphere.load(hdri, pixels=9)
    theta_h, theta_d, phi_d = sphere.angles.unbind(-1)
    cos_i = theta_d.cos() * theta_h.cos() - theta_d.sin() * phi_d.cos() * theta_h.sin()
    assert (sphere.weights[:, cos_i < -1e-6] == 0).all()


def test_radiance_pixels_by_hand(tmp_path: Path):
    """Two rows of eight pixels: a run and a literal, mantissa / 256 x 2^(exponent - 128)."""
    run = b"".join(bytes((128 + 8, value)) for value in (128, 64, 0, 129))
    literal = bytes((8, *range(8))) + bytes((128 + 8, 0)) * 2 + bytes((128 + 8, 136))
    line = bytes((2, 2, 0, 8))
    path = tmp_path / "two.hdr"
    path.write_bytes(b"#?RADIANCE\n\n-Y 2 +X 8\n" + line + run + line + literal)
    pixels = read_radiance(path)
    np.testing.assert_allclose(pixels[0], [[1.0, 0.5, 0.0]] * 8)
    np.testing.assert_allclose(pixels[1, :, 0], np.arange(8))
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(InputError, match=r"two\.hdr"):
        read_radiance(path)


@pytest.mark.slow
def test_the_bundled_encoder_keeps_its_promise(data_folder: Path, tmp_path: Path):
    """The floors of the first release, on a small sphere; the full one is in the README."""
    evaluate_representation(data_folder, tmp_path, pixels=12, methods=("ours",), sets=UNIFORM)
    ours = json.loads((tmp_path / "representation.json").read_text())["methods"]["ours"]
    for name, floor in (("torrance_sparrow", 43), ("disney", 31), ("merl_held_out", 30)):
        assert ours["sets"][name]["mean"] >= floor, name
    assert "steel" in ours["sets"]["merl_held_out"]["materials"]
    assert ours["sets"]["merl_held_out"]["n"] == 5
    assert ours["sets"]["rgl"]["n"] == 41
