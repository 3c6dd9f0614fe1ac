"""A virtual phone with LiDAR, which scans scenes with a known truth.

`raster` finds visible triangles, `look`, `light` and `shading` colour them, `camera` takes one view, `sensor` adds errors, `walk` moves the
phone, and `scan` combines them.
"""

from radartwin.testbed.scanner.scan import ScanTruth, scan
from radartwin.testbed.scanner.sensor import Sensor
from radartwin.testbed.scanner.walk import Walk

__all__ = ["ScanTruth", "Sensor", "Walk", "scan"]
