"""Where results go: names that every system accepts, and no folder that someone else uses."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tvbrdf.model_runtime.output.commit import recover
from tvbrdf.tvbrdf_addon.errors import SettingsError
from tvbrdf.tvbrdf_addon.material.result import read_result
from tvbrdf.tvbrdf_addon.output import file_safe, folder_meant, free_folder, require_writable


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("Painted Steel", "Painted Steel"),
        ("Metall.001", "Metall.001"),
        ("Rost/Stahl: alt?", "Rost_Stahl_ alt_"),
        ("Eisentür ржавчина 錆", "Eisentür ржавчина 錆"),
        ("..", "material"),
        ("", "material"),
        (".hidden", "_hidden"),
        ("ends with a dot.", "ends with a dot"),
        ("NUL", "_NUL"),
        ("com1.steel", "_com1.steel"),
        ("a\nb", "a_b"),
    ],
)
def test_names(name: str, folder: str):
    assert file_safe(name) == folder


@given(st.text())
def test_any_name_is_one_folder(name: str):
    safe = file_safe(name)
    assert safe == Path(safe).name
    assert 0 < len(os.fsencode(safe)) < 200
    assert safe == safe.strip()
    assert not safe.startswith(".")
    assert not set(safe) & set('<>:"/\\|?*')


def test_a_folder_that_is_not_there_is_free(tmp_path: Path):
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel"


def test_an_earlier_result_is_written_over_unless_it_is_shown(tmp_path: Path):
    (tmp_path / "Steel").mkdir()
    (tmp_path / "Steel" / "aged.json").write_text('{"files": {}}')
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel"
    assert free_folder(tmp_path, "Steel", [tmp_path / "Steel"]) == tmp_path / "Steel.001"


def test_the_users_own_files_are_left_alone(tmp_path: Path):
    (tmp_path / "Steel").mkdir()
    (tmp_path / "Steel" / "photo.jpg").write_text("")
    (tmp_path / "Steel.001").write_text("a file")
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel.002"


def test_names_that_differ_in_case_do_not_share_a_folder(tmp_path: Path):
    assert free_folder(tmp_path, "steel", [tmp_path / "Steel"]) == tmp_path / "steel.001"


def test_writable(tmp_path: Path):
    require_writable(tmp_path / "not" / "yet" / "there")
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="not a folder"):
        require_writable(tmp_path / "file" / "below")


def test_a_name_that_is_too_long_is_said(tmp_path: Path):
    for attempt in (
        lambda: require_writable(tmp_path / ("x" * 300) / "Steel"),
        lambda: free_folder(tmp_path / ("x" * 300), "Steel", []),
    ):
        with pytest.raises(SettingsError, match="cannot be used"):
            attempt()


def test_a_report_of_somebody_else_is_no_earlier_result(tmp_path: Path):
    """The worker would refuse to write over it."""
    (tmp_path / "Steel").mkdir()
    (tmp_path / "Steel" / "aged.json").write_text('{"age": 7}')
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel.001"


def test_what_a_killed_worker_has_staged_takes_no_folder(tmp_path: Path):
    (tmp_path / "Steel" / ".aged.partial-abcd_012").mkdir(parents=True)
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel"
    (tmp_path / "Steel" / ".hidden").touch()
    assert free_folder(tmp_path, "Steel", []) == tmp_path / "Steel.001"


def test_only_what_a_killed_worker_left_of_this_result_is_removed(tmp_path: Path):
    for name in (".Steel[1].partial-abcd_012", ".Steel1.partial-efgh_345", "Steel[1]"):
        (tmp_path / name).mkdir()
    recover(tmp_path / "Steel[1]")
    assert {path.name for path in tmp_path.iterdir()} == {".Steel1.partial-efgh_345", "Steel[1]"}


def test_whoever_reads_a_result_undoes_what_a_killed_worker_had_begun(tmp_path: Path):
    """It was killed after it had moved two files aside, and one new one in."""
    folder, staging = tmp_path / "Steel", tmp_path / ".Steel.partial-abcd_012"
    names = [f"{name}_0001.exr" for name in ("base_color", "metallic", "specular", "roughness")]
    files = {name.removesuffix("_0001.exr"): [name] for name in names}
    aged = {"format": "principled", "times": [0.0], "size": [8, 8], "files": files}
    aside = staging / ".aged.earlier"
    for place in (folder, aside):
        place.mkdir(parents=True)
    for k, name in enumerate(names):
        (folder / name).write_text("old")
        (staging / name).write_text("new")
        if k < 2:
            (folder / name).rename(aside / name)
    (staging / names[0]).rename(folder / names[0])
    for place in (folder, staging):
        (place / "aged.json").write_text(json.dumps(aged))
    result = read_result(folder)
    assert [each.files[0].read_text() for each in result.maps] == ["old"] * 4
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.skipif(os.name == "nt", reason="there they are folders of this machine")
class TestPathsOfWindows:
    @pytest.mark.parametrize(
        "text", ["//tex\\aged\\", "//tex\\aged", "//tex/aged/", "//tex/aged\\", "//.\\tex\\aged"]
    )
    def test_beside_the_file_are_folders(self, text: str):
        assert folder_meant(text, "/shots/7/") == Path("/shots/7/tex/aged")

    def test_above_the_file_too(self):
        folder = folder_meant("//..\\tex\\aged\\", "/shots/7/")
        assert Path(os.path.normpath(folder)) == Path("/shots/tex/aged")

    @pytest.mark.parametrize("text", ["C:\\tex\\aged", "c:/tex", "\\\\server\\share\\tex"])
    def test_on_a_drive_are_refused(self, text: str):
        with pytest.raises(SettingsError, match="drive of Windows"):
            folder_meant(text, "/shots/7/")

    def test_a_backslash_in_a_folder_of_this_machine_stays(self):
        assert folder_meant("/tmp/a\\b", "/shots/7/") == Path("/tmp/a\\b")
