"""Reading sequences: stored frames, polynomials, measured mixtures, and what is refused."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from model_runtime.errors import InputError
from model_runtime.images import write_exr
from model_runtime.representation import load_representation
from model_runtime.temporal.pace import Timing
from training.data.folder import Sample
from training.data.location import data_folder as find_data
from training.data.sequences import MixtureSequence, Sequence, read_sequence
from training.source.histories import source_histories

CENTER = (slice(80, 380), slice(80, 380))  # the crop of data/README.md


def write_frames(folder, *, frames=3, size=(4, 6), alpha_size=None):
    rng = np.random.default_rng(1)
    for k in range(1, frames + 1):
        write_exr(folder / f"kd_{k:04d}.exr", rng.random((*size, 3), np.float32))
        write_exr(folder / f"ks_{k:04d}.exr", rng.random((*size, 3), np.float32))
        write_exr(folder / f"alpha_{k:04d}.exr", np.full(alpha_size or size, k / 8, np.float32))


def read_maps(folder, **options) -> Sequence:
    sequence = read_sequence(folder, **options)
    assert isinstance(sequence, Sequence)
    return sequence


def test_stored_frames(tmp_path):
    write_frames(tmp_path)
    sequence = read_maps(tmp_path)
    assert sequence.kd.shape == sequence.ks.shape == (3, 4, 6, 3)
    assert sequence.alpha[:, 0, 0].tolist() == [0.125, 0.25, 0.375]
    assert sequence.times.tolist() == [0, 0.5, 1]
    assert sequence.onset is None
    assert sequence.name == tmp_path.name


def test_onset_and_times_where_they_are_given(tmp_path):
    write_frames(tmp_path)
    write_exr(tmp_path / "onset.exr", np.full((4, 6), 0.25, np.float32))
    (tmp_path / "sequence.json").write_text('{"times": [0, 0.75, 1]}')
    sequence = read_maps(tmp_path)
    assert sequence.onset is not None
    assert (sequence.onset == 0.25).all()
    assert sequence.times.tolist() == [0, 0.75, 1]


def test_timing_where_it_is_given(tmp_path):
    write_frames(tmp_path)
    assert read_maps(tmp_path).timing is None
    timing = Timing.of(0.25, scale=0.1)
    (tmp_path / "sequence.json").write_text(
        json.dumps({"times": [0, 0.5, 1], "timing": timing.json()})
    )
    assert read_maps(tmp_path).timing == timing
    for broken in ("null", "[]", '{"onset": 1}', json.dumps({**timing.json(), "scale": -1})):
        (tmp_path / "sequence.json").write_text(f'{{"times": [0, 0.5, 1], "timing": {broken}}}')
        with pytest.raises(InputError, match="describes no timing"):
            read_sequence(tmp_path)


def test_a_sample_keeps_the_same_texels_of_every_map(tmp_path):
    write_frames(tmp_path)
    whole = read_maps(tmp_path)
    some, same, others = (read_maps(tmp_path, sample=Sample(9, seed)) for seed in (1, 1, 2))
    assert some.alpha.shape == (3, 9, 1)
    places = [np.argwhere((whole.kd[0] == texel).all(-1))[0] for texel in some.kd[0, :, 0]]
    rows, columns = np.transpose(places)
    for name in ("kd", "ks", "alpha"):
        kept, every = (getattr(sequence, name) for sequence in (some, whole))
        assert np.array_equal(kept[:, :, 0], every[:, rows, columns])
    assert np.array_equal(some.kd, same.kd)
    assert not np.array_equal(some.kd, others.kd)
    assert read_maps(tmp_path, sample=Sample(99, 1)).alpha.shape == (3, 24, 1)


def test_a_crop_keeps_rows_and_columns(tmp_path):
    write_frames(tmp_path)
    whole = read_maps(tmp_path)
    part = read_maps(tmp_path, crop=(slice(1, 3), slice(0, 5)))
    np.testing.assert_array_equal(part.kd, whole.kd[:, 1:3, 0:5])
    with pytest.raises(InputError, match="Nothing of"):
        read_sequence(tmp_path, crop=(slice(4, 8), slice(0, 5)))


def test_polynomials_by_hand(tmp_path):
    """p(1/2) of 0.5, 0.25, -1, 2 is 0.5 + 0.125 - 0.25 + 0.25 = 0.625, p(1) = 1.75."""
    for name in ("Diffuse", "Specular", "Roughness"):
        for k, coefficient in enumerate((0.5, 0.25, -1.0, 2.0)):
            write_exr(tmp_path / f"{name}-{k}.exr", np.full((2, 2, 3), coefficient, np.float32))
    sequence = read_maps(tmp_path, frames=3, clamp=False)
    for values in (sequence.kd, sequence.ks):
        np.testing.assert_allclose(values[:, 1, 0, 2], (0.5, 0.625, 1.75))
    np.testing.assert_allclose(sequence.alpha[:, 1, 0], (0.5, 0.625, 1.75))
    assert read_maps(tmp_path, frames=3).alpha.max() == 1


def test_rusting_iron_has_the_published_statistics(data_folder):
    """The numbers of data/README.md for the center of tvBTF45, at t = 0, .5 and 1."""
    folder = data_folder / "tvbtf" / "tvBTF45"
    raw = read_maps(folder, frames=3, crop=CENTER, clamp=False)
    kd = ((0.066, 0.075, 0.072), (0.090, 0.056, 0.041), (0.066, 0.052, 0.043))
    np.testing.assert_allclose(raw.kd.mean((1, 2)), kd, atol=6e-4)
    np.testing.assert_allclose(raw.ks.mean((1, 2, 3)), (0.216, 0.011, -0.002), atol=6e-4)
    np.testing.assert_allclose((raw.ks < 0).any(-1).mean((1, 2))[1:], (0.06, 0.54), atol=6e-3)
    np.testing.assert_array_equal(raw.out_of_range()[1:] >= (raw.ks[1:] < 0).any(-1), True)

    whole = read_maps(folder, frames=3, clamp=False)  # whose alphas the table gives
    np.testing.assert_allclose(np.median(whole.alpha, (1, 2)), (0.061, 0.188, 0.250), atol=6e-4)
    assert np.mean(whole.alpha[0] < 0) == pytest.approx(1e-4, abs=5e-5)

    clamped = read_maps(folder, frames=3, crop=CENTER)
    assert clamped.ks.min() == 0
    assert not clamped.out_of_range().any()


def write_mixture(folder, materials: list[str]) -> None:
    (folder / "mixture.json").write_text(json.dumps({"materials": materials}))
    for k in range(1, 6):
        write_exr(folder / f"w_{k:04d}.exr", np.full((3, 2), (k - 1) / 4, np.float32))


def test_a_measured_mixture(tmp_path):
    write_mixture(tmp_path, ["steel", "alum-bronze"])
    sequence = read_sequence(tmp_path)
    assert isinstance(sequence, MixtureSequence)
    assert sequence.materials == ("steel", "alum-bronze")
    np.testing.assert_allclose(sequence.weights[:, 2, 1], (0, 0.25, 0.5, 0.75, 1))
    np.testing.assert_allclose(sequence.times, (0, 0.25, 0.5, 0.75, 1))

    write_exr(tmp_path / "w_0003.exr", np.full((3, 2), 1.5, np.float32))
    with pytest.raises(InputError, match="leave 0 to 1"):
        read_sequence(tmp_path)
    (tmp_path / "mixture.json").write_text('{"materials": ["steel"]}')
    with pytest.raises(InputError, match="does not name two"):
        read_sequence(tmp_path)


def test_a_gap_is_named(tmp_path):
    write_frames(tmp_path, frames=4)
    (tmp_path / "ks_0003.exr").unlink()
    with pytest.raises(InputError, match=r"lacks ks_0003\.exr"):
        read_sequence(tmp_path)


@pytest.mark.parametrize("number", ["999999999", "9" * 200, "0000"])
def test_a_number_beyond_counting_is_a_gap(tmp_path, number: str):
    """Nothing is counted up to it, so that it takes neither memory nor time."""
    write_frames(tmp_path, frames=3)
    (tmp_path / f"kd_{number}.exr").write_bytes(b"")
    with pytest.raises(InputError, match=r"lacks kd_0004\.exr"):
        read_sequence(tmp_path)


def test_more_frames_than_a_model_can_have(tmp_path):
    for k in range(1, 1002):
        for name in ("kd", "ks", "alpha"):
            (tmp_path / f"{name}_{k:04d}.exr").touch()
    with pytest.raises(InputError, match="has 1,001 frames"):
        read_sequence(tmp_path)
    (tmp_path / "Diffuse-0.exr").touch()
    for file in tmp_path.glob("*_*.exr"):
        file.unlink()
    with pytest.raises(InputError, match="cannot have 1001 frames"):
        read_sequence(tmp_path, frames=1001)


def test_more_texels_than_memory_holds(tmp_path):
    """Of which the first frame is read, and none of the 999 others."""
    for k in range(1, 1001):
        for name in ("kd", "ks", "alpha"):
            (tmp_path / f"{name}_{k:04d}.exr").touch()
    write_exr(tmp_path / "kd_0001.exr", np.zeros((600, 600), np.float32))
    with pytest.raises(InputError, match="1000 frames of 600 x 600"):
        read_sequence(tmp_path)


ODD_JSON = {
    "not UTF-8": b'{"times": [0, 0.5, 1], "x": "\xff"}',
    "deep": b"[" * 100_000,
    "a number": b"5",
    "null": b"null",
    "an endless number": b'{"times": [0, 0.5, 1e999]}',
    "a long number": b'{"times": [0, 0.5, ' + b"9" * 4000 + b"]}",
    "texts": b'{"times": ["0", "x", []]}',
    "large": b" " * (2 << 20) + b'{"times": [0, 0.5, 1]}',
}


@pytest.mark.parametrize("content", ODD_JSON.values(), ids=ODD_JSON.keys())
def test_json_of_any_kind_is_a_sentence(tmp_path, content: bytes):
    write_frames(tmp_path)
    (tmp_path / "sequence.json").write_bytes(content)
    with pytest.raises(InputError, match=r"sequence\.json of .* rising time"):
        read_sequence(tmp_path)
    (tmp_path / "mixture.json").write_bytes(content)
    with pytest.raises(InputError, match=r"mixture\.json of .* two materials"):
        read_sequence(tmp_path)


@pytest.mark.parametrize("materials", ['["a", null]', '"ab"', '{"a": 1, "b": 2}', "[[], []]"])
def test_materials_that_are_no_names(tmp_path, materials: str):
    (tmp_path / "mixture.json").write_text(f'{{"materials": {materials}}}')
    with pytest.raises(InputError, match="two materials"):
        read_sequence(tmp_path)


def test_materials_that_nobody_measured(tmp_path, data_folder):
    write_mixture(tmp_path, ["steel", "\x1b[2Junobtainium"])
    mixture = read_sequence(tmp_path)
    representation, _ = load_representation()
    with pytest.raises(InputError, match=r"no measured material called .*unobtainium") as caught:
        source_histories(mixture, representation)
    assert str(caught.value).isprintable()


def test_files_that_are_none_are_not_waited_for(tmp_path):
    write_frames(tmp_path)
    os.mkfifo(tmp_path / "sequence.json")
    with pytest.raises(InputError, match="rising time"):
        read_sequence(tmp_path)
    (tmp_path / "sequence.json").unlink()
    (tmp_path / "ks_0002.exr").unlink()
    os.mkfifo(tmp_path / "ks_0002.exr")
    with pytest.raises(InputError, match=r"ks_0002\.exr is not a file"):
        read_sequence(tmp_path)


def test_a_folder_that_cannot_be_read(tmp_path, monkeypatch):
    for path in (tmp_path / ("x" * 300), tmp_path / "half \ud800"):
        with pytest.raises(InputError, match="folder"):
            read_sequence(path)

    def denied(self: Path):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "iterdir", denied)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        read_sequence(tmp_path)


def test_a_map_that_ends_early_is_named(tmp_path):
    write_frames(tmp_path, frames=4)
    (tmp_path / "alpha_0004.exr").unlink()
    with pytest.raises(InputError, match="4 kd, 4 ks, 3 alpha"):
        read_sequence(tmp_path)


def test_a_missing_coefficient_is_named(tmp_path):
    for k in range(4):
        write_exr(tmp_path / f"Diffuse-{k}.exr", np.zeros((2, 2, 3), np.float32))
    with pytest.raises(InputError, match=r"lacks Specular-0\.exr"):
        read_sequence(tmp_path)


def test_maps_of_different_sizes_are_refused(tmp_path):
    write_frames(tmp_path, alpha_size=(2, 3))
    with pytest.raises(InputError, match="kd 6 x 4, ks 6 x 4, alpha 3 x 2"):
        read_sequence(tmp_path)


def test_frames_of_different_sizes_are_refused(tmp_path):
    write_frames(tmp_path)
    write_exr(tmp_path / "kd_0002.exr", np.zeros((5, 5, 3), np.float32))
    with pytest.raises(InputError, match=r"kd_0002\.exr differs in size"):
        read_sequence(tmp_path)


def test_a_single_frame_is_refused(tmp_path):
    write_frames(tmp_path, frames=1)
    with pytest.raises(InputError, match="only one frame"):
        read_sequence(tmp_path)


def test_values_that_are_not_numbers_are_refused(tmp_path):
    write_frames(tmp_path)
    for value in (np.nan, np.inf, 1e30, -3e38):
        broken = np.zeros((4, 6), np.float32)
        broken[2, 3] = value
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": broken}).write(
            str(tmp_path / "alpha_0002.exr")
        )
        with pytest.raises(InputError, match=r"alpha_0002\.exr holds values that are not numbers"):
            read_sequence(tmp_path)


def test_times_that_do_not_fit_are_refused(tmp_path):
    write_frames(tmp_path)
    for text in ('{"times": [0, 1]}', '{"times": [0, 0.5, 0.5]}', "[]", "not json"):
        (tmp_path / "sequence.json").write_text(text)
        with pytest.raises(InputError, match="does not give a rising time"):
            read_sequence(tmp_path)


def test_nothing_to_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no sequence"):
        read_sequence(tmp_path)
    with pytest.raises(InputError, match="There is no folder"):
        read_sequence(tmp_path / "absent")


def test_the_data_folder_names_its_setting(tmp_path, monkeypatch):
    monkeypatch.setenv("TVBRDF_DATA", str(tmp_path))
    assert find_data() == tmp_path
    monkeypatch.setenv("TVBRDF_DATA", str(tmp_path / "absent"))
    with pytest.raises(InputError, match="Set TVBRDF_DATA"):
        find_data()
