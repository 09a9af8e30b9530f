"""RGL `.bsdf` files: values against the reference samples, and refusal of what is not one."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.brdf import rgl
from model_runtime.brdf.half_angle import directions, from_directions
from model_runtime.errors import InputError

CODES = {"|u1": 1, "<u4": 5, "<f4": 10}
MATERIALS = ("acrylic_felt_green", "ilm_l3_37_matte")


def tensor_file(fields: dict[str, np.ndarray]) -> bytes:
    """A tensor file as data/README.md describes it."""
    table = sum(2 + len(name) + 2 + 1 + 8 + 8 * array.ndim for name, array in fields.items())
    header = b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields))
    offset, data = len(header) + table, b""
    for name, array in fields.items():
        code = CODES[array.dtype.str]
        header += struct.pack("<H", len(name)) + name.encode()
        header += struct.pack("<HBQ", array.ndim, code, offset + len(data))
        header += struct.pack(f"<{array.ndim}Q", *array.shape)
        data += array.tobytes()
    return header + data


def plain_fields(grid: int = 4) -> dict[str, np.ndarray]:
    """A material whose normals are spread so that the warp is the identity: constant tables."""
    return {
        "phi_i": np.zeros(1, "<f4"),
        "theta_i": np.linspace(0, math.pi / 2, 3, dtype="<f4"),
        "sigma": np.full((2, 8), 0.5, "<f4"),
        "ndf": np.full((2, 8), 0.3, "<f4"),
        "vndf": np.full((1, 3, 6, 5), 0.2, "<f4"),
        "luminance": np.ones((1, 3, grid, grid), "<f4"),
        "rgb": np.ones((1, 3, 3, grid, grid), "<f4")
        * np.array([0.1, 0.2, 0.4], "<f4")[:, None, None],
    }


def random_angles(count: int, seed: int = 0) -> torch.Tensor:
    wi, wo = torch.nn.functional.normalize(
        torch.randn(2, count, 3, generator=torch.Generator().manual_seed(seed)), dim=-1
    )
    wi[:, 2], wo[:, 2] = wi[:, 2].abs() + 0.05, wo[:, 2].abs() + 0.05
    return from_directions(*(torch.nn.functional.normalize(w, dim=-1) for w in (wi, wo)))


@pytest.mark.parametrize("index", [0, 1])
def test_measured_files_agree_with_the_reference_samples(data_folder: Path, index: int) -> None:
    samples = np.load(data_folder / "bsdf" / "rgl_reference_samples.npz", allow_pickle=False)
    assert tuple(samples["names"]) == MATERIALS
    brdf = rgl.read(data_folder / "bsdf" / f"{MATERIALS[index]}_rgb.bsdf")
    f = brdf.evaluate(torch.from_numpy(samples["angles"])).numpy()
    np.testing.assert_allclose(f, samples["rgb"][index], rtol=2e-5, atol=1e-6)


def test_value_does_not_depend_on_the_batch(data_folder: Path) -> None:
    brdf = rgl.read(data_folder / "bsdf" / f"{MATERIALS[0]}_rgb.bsdf")
    angles = random_angles(1000)
    together = brdf.evaluate(angles)
    apart = torch.cat([brdf.evaluate(part) for part in angles.split(37)])
    assert torch.equal(together, apart)


def test_constant_tables_give_the_formula(tmp_path: Path) -> None:
    path = tmp_path / "plain_rgb.bsdf"
    path.write_bytes(tensor_file(plain_fields()))
    brdf = rgl.read(path)
    angles = random_angles(500)
    cos_o = directions(angles)[1][:, 2:]
    expected = torch.tensor([0.1, 0.2, 0.4]) * 0.3 / (4 * 0.5) / cos_o
    assert brdf.name == "plain_rgb"
    torch.testing.assert_close(brdf.evaluate(angles), expected, rtol=1e-5, atol=0)


def test_warp_follows_the_density_of_normals(tmp_path: Path) -> None:
    # A density 2 u along u takes u to s = u^2; with rgb = s the value must be u^2 = 2 theta_h / pi.
    fields = plain_fields()
    ramp = np.linspace(0, 1, 257, dtype="<f4")
    fields["vndf"] = np.broadcast_to(ramp, (1, 3, 6, 257)).astype("<f4")
    fields["rgb"] = np.broadcast_to(np.linspace(0, 1, 4, dtype="<f4"), (1, 3, 3, 4, 4)).astype(
        "<f4"
    )
    path = tmp_path / "ramp_rgb.bsdf"
    path.write_bytes(tensor_file(fields))
    angles = random_angles(500)
    cos_o = directions(angles)[1][:, 2:]
    s = angles[:, :1] * 2 / math.pi
    expected = (s * 0.3 / (4 * 0.5) / cos_o).expand(-1, 3)
    torch.testing.assert_close(rgl.read(path).evaluate(angles), expected, rtol=1e-4, atol=1e-5)


def test_below_the_horizon_is_black(tmp_path: Path) -> None:
    path = tmp_path / "plain_rgb.bsdf"
    path.write_bytes(tensor_file(plain_fields()))
    angles = torch.tensor([[1.2, 1.2, 0.0], [1.2, 1.2, math.pi], [math.pi / 2, 0.1, 0.3]])
    assert torch.equal(rgl.read(path).evaluate(angles), torch.zeros(3, 3))


def _anisotropic(fields: dict[str, np.ndarray]) -> None:
    fields["phi_i"] = np.linspace(-math.pi, math.pi, 8, dtype="<f4")


def _spectral(fields: dict[str, np.ndarray]) -> None:
    fields["spectra"] = fields.pop("rgb")
    fields["wavelengths"] = np.linspace(360, 1000, 195, dtype="<f4")


def _nan(fields: dict[str, np.ndarray]) -> None:
    fields["rgb"] = fields["rgb"].copy()
    fields["rgb"][0, 0, 0, 0, 0] = np.nan


def _no_normals(fields: dict[str, np.ndarray]) -> None:
    fields["vndf"] = np.zeros_like(fields["vndf"])


def _other_slices(fields: dict[str, np.ndarray]) -> None:
    fields["theta_i"] = np.linspace(0, 1.5, 4, dtype="<f4")


def _descending(fields: dict[str, np.ndarray]) -> None:
    fields["theta_i"] = fields["theta_i"][::-1].copy()


def _integer(fields: dict[str, np.ndarray]) -> None:
    fields["ndf"] = np.ones((2, 8), "<u4")


def _one_row(fields: dict[str, np.ndarray]) -> None:
    fields["sigma"] = np.ones((1, 8), "<f4")


def _absurd(field: str, value: float):
    def change(fields: dict[str, np.ndarray]) -> None:
        fields[field] = fields[field].copy()
        fields[field].reshape(-1)[-1] = value

    return change


def _large(fields: dict[str, np.ndarray]) -> None:
    fields["sigma"] = np.full((4096, 4096), 0.5, "<f4")


def _no_ndf(fields: dict[str, np.ndarray]) -> None:
    del fields["ndf"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (_anisotropic, "anisotropic"),
        (_spectral, "spectral"),
        (_nan, "NaN"),
        (_no_normals, "distribution of normals"),
        (_other_slices, "do not fit"),
        (_descending, "do not fit"),
        (_integer, "wrong type"),
        (_one_row, "unusable grid"),
        (_no_ndf, "lacks the fields ndf"),
        (_large, "larger than any"),
        *(
            (_absurd(field, value), "without sense")
            for field in ("rgb", "ndf", "sigma", "vndf", "theta_i")
            for value in (3e38, -1e30)
        ),
        (_absurd("theta_i", 10.0), "do not fit"),
    ],
)
def test_other_measurements_are_refused_with_a_sentence(tmp_path: Path, change, sentence) -> None:
    fields = plain_fields()
    change(fields)
    path = tmp_path / "other.bsdf"
    path.write_bytes(tensor_file(fields))
    with pytest.raises(InputError, match=sentence) as caught:
        rgl.read(path)
    assert "other.bsdf" in caught.value.message
    assert caught.value.hint


@pytest.mark.parametrize(
    ("field", "value"), [("rgb", 1e12), ("ndf", 1e12), ("sigma", 1e-30), ("sigma", 1e-45)]
)
def test_fields_that_together_make_absurd_values_are_refused_when_asked(
    tmp_path: Path, field: str, value: float
) -> None:
    fields = plain_fields()
    fields[field] = np.full_like(fields[field], value)
    (tmp_path / "x.bsdf").write_bytes(tensor_file(fields))
    brdf = rgl.read(tmp_path / "x.bsdf")
    with pytest.raises(InputError, match=r"x\.bsdf holds values that no material has"):
        brdf.evaluate(random_angles(50))


def test_missing_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        rgl.read(tmp_path / "absent.bsdf")
    (tmp_path / "text.bsdf").write_text("not a measurement")
    with pytest.raises(InputError, match=r"not a \.bsdf"):
        rgl.read(tmp_path / "text.bsdf")


WHOLE = tensor_file(plain_fields())


@settings(max_examples=200, deadline=None)
@given(st.integers(0, len(WHOLE) - 1))
def test_cut_files_are_refused(tmp_path_factory: pytest.TempPathFactory, length: int) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.bsdf"
    path.write_bytes(WHOLE[:length])
    with pytest.raises(InputError):
        rgl.read(path)


@settings(max_examples=300, deadline=None)
@given(st.integers(12, 400), st.integers(0, 255))
def test_a_damaged_table_is_refused_or_gives_finite_values(
    tmp_path_factory: pytest.TempPathFactory, position: int, value: int
) -> None:
    content = bytearray(WHOLE)
    content[position] = value
    path = tmp_path_factory.getbasetemp() / "damaged.bsdf"
    path.write_bytes(content)
    try:
        f = rgl.read(path).evaluate(random_angles(50))
    except InputError:
        return
    assert f.isfinite().all()
