"""Which folder the Output setting means."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tvbrdf.tvbrdf_addon.errors import SettingsError
from tvbrdf.tvbrdf_addon.output import folder_meant


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
