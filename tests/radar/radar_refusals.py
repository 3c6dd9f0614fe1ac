"""Check of the message that refuses a radar file."""

import pytest

from radartwin.errors import RecordingError
from radartwin.radar.chirp import Radar


def assert_refused(path, *words):
    """The file is refused by one short line that names the file and contains the words."""
    with pytest.raises(RecordingError) as caught:
        Radar.from_file(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    for word in (path.name, *words):
        assert word in message
