"""Check the error message with which RadarTwin refuses a radar file."""

import pytest

from radartwin.errors import RecordingError
from radartwin.radar.chirp import Radar


def assert_refused(path, *words):
    """Check that RadarTwin refuses the file with one short line that names the file and contains the given words."""
    with pytest.raises(RecordingError) as caught:
        Radar.from_file(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    for word in (path.name, *words):
        assert word in message
