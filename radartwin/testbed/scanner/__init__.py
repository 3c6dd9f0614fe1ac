"""A simulated phone with LiDAR that scans rooms. The true geometry and materials of the scanned room are known.

The module `raster` finds the visible triangles of the room. The modules `look`, `light` and `shading` compute the triangles' colours. The
module `camera` computes one view, `sensor` adds measurement errors, `walk` moves the phone, and `scan` combines all of these modules.
"""

from radartwin.testbed.scanner.scan import ScanTruth, scan
from radartwin.testbed.scanner.sensor import Sensor

__all__ = ["ScanTruth", "Sensor", "scan"]
