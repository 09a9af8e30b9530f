"""A look at where aging starts: pictures of the object, before anything ages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.contract import LIVE, LOOKS
from model_runtime.errors import InputError
from model_runtime.images import write_exr
from model_runtime.look import look
from model_runtime.request import request_from
from model_runtime.surface.pictures import seen_from
from tests.meshes import atlas_of, ball, box, write_vectors

BLOCK = atlas_of(box((5, 0, 0.5), (1, 1, 1)), 128)


class Silent:
    def progress(self, stage: str, fraction: float) -> None: ...

    def warning(self, message: str) -> None: ...

    def cancelled(self) -> bool:
        return False


@pytest.fixture
def asked(tmp_path: Path) -> dict[str, object]:
    maps, surface = tmp_path / "maps", tmp_path / "surface"
    maps.mkdir()
    surface.mkdir()
    write_exr(maps / "BaseColor.exr", np.full((64, 64, 3), 0.5, np.float32))
    write_vectors(surface / "position.exr", BLOCK.position, BLOCK.covered)
    write_vectors(surface / "normal.exr", BLOCK.normal)
    places = {"input": str(maps), "surface": str(surface), "output": str(tmp_path / "out")}
    return {"ntm": "rust", "binding": LIVE, **places}


def test_pictures_show_the_object_from_two_sides(asked, tmp_path):
    told = look(request_from(asked), Silent())
    assert told["pictures"] == [*LOOKS]
    assert told["surface"]["points"] > 1000
    for name in LOOKS:
        picture = np.asarray(Image.open(tmp_path / "out" / name))
        assert picture.shape == (256, 256, 4)
        assert 0.2 < (picture[..., 3] > 0).mean() < 0.8
        assert picture[picture[..., 3] > 0][:, :3].std() > 10
    assert not (tmp_path / "out" / "aged.json").exists()


def test_what_is_looked_at_depends_on_what_is_asked_for(asked, tmp_path):
    def picture(**changes: object) -> np.ndarray:
        look(request_from(asked | changes), Silent())
        return np.asarray(Image.open(tmp_path / "out" / "front.png")).astype(float)

    assert np.abs(picture() - picture(exposure="sky=1,edges=0,crevices=0")).mean() > 5


def test_where_nothing_grows_there_is_nothing_to_look_at(asked):
    with pytest.raises(InputError, match="at once"):
        look(request_from({**asked, "onset": "none"}), Silent())


def test_what_is_near_hides_what_is_far_and_first_is_dark():
    """A small ball in front of a block, which starts at once; the block never does."""
    atlas = atlas_of([*box((0, 0, 0), (2, 2, 2)), *ball((0, -3, 0), 0.5)], 256)
    near = np.linalg.norm(atlas.position - (0, -3, 0), axis=-1) < 0.6
    onset = np.where(near, 0, 1).astype(np.float32)
    front, back = (seen_from((0, y, 0), atlas, onset) for y in (-1, 1))
    red, blue = front[128, 128, 0], front[128, 128, 2]
    assert red > 2 * blue
    assert back[128, 128, 2] > back[128, 128, 0]
    assert front[0, 0, 3] == 0
    assert (front[110:146, 100:156, 3] == 1).all(), "without holes"
