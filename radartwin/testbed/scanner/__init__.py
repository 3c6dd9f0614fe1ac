"""A virtual phone with LiDAR. It scans scenes whose true geometry and materials are known.

`raster` finds the visible triangles. `look`, `light` and `shading` compute their colours. `camera` computes one view, `sensor` adds errors,
and `walk` moves the phone. `scan` combines all of these modules.
"""

from radartwin.testbed.scanner.scan import ScanTruth, scan
from radartwin.testbed.scanner.sensor import Sensor

__all__ = ["ScanTruth", "Sensor", "scan"]
