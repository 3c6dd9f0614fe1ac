"""What a simulation knows of an object: walls and contents, or the surface only."""

import pytest

from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.materials import Layered
from radartwin.scene.objects.catalogue import entry


def test_unknown_contents_leave_the_outermost_material():
    known, unknown = (entry("mustard").surfaces(contents=contents) for contents in ("filled", "unknown"))
    assert known[0].material == Layered([("hdpe", 0.0008)], backing="mustard")
    assert unknown[0].material == Layered([], backing="hdpe")
    assert unknown[0].mesh.vertices.tobytes() == known[0].mesh.vertices.tobytes()


def test_a_wrong_word_for_contents_is_one_line():
    with pytest.raises(ConfigError, match="contents=full is not known; options: filled, unknown"):
        compose(["contents=full"])
