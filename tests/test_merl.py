"""MERL `.binary` files: the layout of the published reader, interpolation, and damaged files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.brdf import merl, torrance_sparrow
from model_runtime.brdf.half_angle import above_horizon
from model_runtime.errors import InputError, OutputError

WHITE = np.array([0.2, 0.4, 0.8]) / math.pi


def index_of_published_reader(theta_h: float, theta_d: float, phi_d: float) -> int:
    """`BRDFRead.cpp` (MERL 2006): theta_half_index, theta_diff_index, phi_diff_index, lookup."""
    i = min(89, int(math.sqrt(theta_h / (math.pi / 2 / 90) * 90)))
    j = min(89, int(theta_d / (math.pi * 0.5) * 90))
    k = min(179, int((phi_d + math.pi if phi_d < 0 else phi_d) / math.pi * 360 / 2))
    return k + j * 180 + i * 180 * 90


@pytest.fixture(scope="module")
def smooth_table() -> np.ndarray:
    """Torrance-Sparrow on MERL's grid, -1 where a direction is below the horizon."""
    angles = merl.grid_angles().reshape(-1, 3).float()
    f = torrance_sparrow.evaluate(
        torch.tensor([[0.2, 0.1, 0.05]]),
        torch.tensor([[0.3, 0.3, 0.2]]),
        torch.tensor([0.3]),
        angles,
    )[0]
    table = torch.where(above_horizon(angles)[:, None], f, -1)
    return table.reshape(*merl.GRID, 3).numpy()


@pytest.fixture(scope="module")
def smooth_file(smooth_table: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("merl") / "smooth.binary"
    merl.write(path, smooth_table)
    return path


def visible_angles(count: int, margin: float = 0.1) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    angles = torch.rand(count * 4, 3, generator=generator)
    angles = angles * torch.tensor([math.pi / 2, math.pi / 2, 2 * math.pi])
    return angles[above_horizon(angles, margin=margin)][:count]


def test_file_is_laid_out_as_the_published_reader_expects(
    smooth_file: Path, smooth_table: np.ndarray
) -> None:
    content = smooth_file.read_bytes()
    assert len(content) == 34_992_012
    assert np.frombuffer(content[:12], "<i4").tolist() == [90, 90, 180]
    values = np.frombuffer(content, "<f8", offset=12)
    scales = (1.0 / 1500, 1.15 / 1500, 1.66 / 1500)
    for i, j, k in ((0, 0, 0), (10, 20, 30), (30, 5, 170), (45, 1, 90)):
        entry = index_of_published_reader(
            ((i + 0.5) / 90) ** 2 * math.pi / 2,
            (j + 0.5) / 90 * math.pi / 2,
            (k + 0.5) / 180 * math.pi,
        )
        for channel in range(3):
            read = values[entry + channel * 90 * 90 * 180] * scales[channel]
            assert read == pytest.approx(smooth_table[i, j, k, channel], rel=1e-6)


def test_every_measured_entry_is_given_back(smooth_file: Path, smooth_table: np.ndarray) -> None:
    angles = merl.grid_angles()[::7, ::11, ::13].reshape(-1, 3)
    stored = torch.from_numpy(smooth_table[::7, ::11, ::13].reshape(-1, 3))
    inside = above_horizon(angles, margin=0.02)
    f = merl.read(smooth_file).evaluate(angles).float()
    torch.testing.assert_close(f[inside], stored[inside], rtol=1e-4, atol=1e-6)


def test_between_entries_a_smooth_material_is_met(smooth_file: Path) -> None:
    angles = visible_angles(4000)
    expected = torrance_sparrow.evaluate(
        torch.tensor([[0.2, 0.1, 0.05]]),
        torch.tensor([[0.3, 0.3, 0.2]]),
        torch.tensor([0.3]),
        angles,
    )[0]
    error = (merl.read(smooth_file).evaluate(angles) - expected).abs() / expected
    assert error.mean() < 2e-3
    assert error.max() < 0.05


def test_unmeasured_neighbors_do_not_darken_the_rim(tmp_path: Path) -> None:
    angles = merl.grid_angles()
    table = np.where(above_horizon(angles, margin=0.05)[..., None].numpy(), WHITE, -1.0)
    path = tmp_path / "white.binary"
    merl.write(path, table)
    brdf = merl.read(path)
    f = brdf.evaluate(visible_angles(5000, margin=0.1))
    torch.testing.assert_close(f, torch.tensor(WHITE).float().expand_as(f), rtol=1e-5, atol=0)
    assert brdf.name == "white"


def test_phi_has_period_pi_and_the_lower_half_is_black(smooth_file: Path) -> None:
    brdf = merl.read(smooth_file)
    angles = visible_angles(500, margin=0.02)
    turned = angles + torch.tensor([0.0, 0.0, math.pi])
    back = angles - torch.tensor([0.0, 0.0, 3 * math.pi])
    torch.testing.assert_close(brdf.evaluate(turned), brdf.evaluate(angles), rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(brdf.evaluate(back), brdf.evaluate(angles), rtol=1e-3, atol=1e-5)
    below = torch.tensor([[1.5, 1.5, 0.0], [math.pi / 2, math.pi / 2, 1.0]])
    assert torch.equal(brdf.evaluate(below), torch.zeros(2, 3))


def test_damaged_files_are_refused_with_a_sentence(smooth_file: Path, tmp_path: Path) -> None:
    content = bytearray(smooth_file.read_bytes())
    path = tmp_path / "bad.binary"

    def refused(sentence: str) -> None:
        with pytest.raises(InputError, match=sentence) as caught:
            merl.read(path)
        assert "bad.binary" in caught.value.message
        assert caught.value.hint

    refused("cannot be read")
    for length in (0, 11):
        path.write_bytes(content[:length])
        refused("cut short")
    for length in (12, 5000, len(content) - 1):
        path.write_bytes(content[:length])
        refused(f"has {length} bytes")
    path.write_bytes(np.array([90, 90, 360], "<i4").tobytes() + content[12:])
    refused("90 x 90 x 360")
    path.write_bytes(np.array([-1, 90, 180], "<i4").tobytes())
    refused("grid of -1 x 90 x 180")
    content[12 : 12 + 8 * 3] = np.array([math.nan, math.inf, 1e300], "<f8").tobytes()
    path.write_bytes(content)
    refused("3 values that are NaN or infinite")
    path.write_bytes(content[:12] + np.full(3 * 90 * 90 * 180, -1.0, "<f8").tobytes())
    refused("no measured value")


@pytest.mark.parametrize("value", [1e30, 1e10])
def test_values_that_no_material_has_are_refused(
    smooth_table: np.ndarray, tmp_path: Path, value: float
) -> None:
    table = smooth_table.astype(np.float64)
    table[3, 4, 5] = value
    merl.write(tmp_path / "x.binary", table)
    with pytest.raises(InputError, match=r"x\.binary holds values that no material has"):
        merl.read(tmp_path / "x.binary")


def test_writing_to_a_missing_folder_is_an_output_error(
    smooth_table: np.ndarray, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        merl.write(tmp_path / "absent" / "x.binary", smooth_table)
