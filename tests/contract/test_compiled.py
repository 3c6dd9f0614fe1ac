"""Newly compiled machine code and machine code from Numba's cache give bit-identical results."""

import os
import subprocess
import sys

import pytest

SIGNAL = """
import hashlib
import numpy as np
import radartwin as rt
from radartwin.scene import rooms

radar = rt.Radar.iwr1843()
pose = rooms.bench("lab").sensor_pose
print(hashlib.sha256(rt.simulate(rooms.room("lab", detail="shell"), radar, pose[None]).iq.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_compiled_now_and_read_from_the_cache_are_the_same(tmp_path):
    """With fused multiply-add instructions, this test failed: the last bits of a room's mirror images depended on which process had
    compiled the code.
    """

    def digest() -> str:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        return subprocess.run([sys.executable, "-c", SIGNAL], env=environment, capture_output=True, text=True, check=True).stdout

    first = digest()
    assert list(tmp_path.rglob("*.nbc")), "nothing was compiled into the cache"
    assert digest() == first
