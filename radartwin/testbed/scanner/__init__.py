"""A virtual phone with LiDAR: scans scenes whose truth is known.

`raster` sees triangles, `look` and `light` colour them, `camera` takes one look, `sensor` errs, `walk` carries the phone, `scan` is
the whole.
"""

from radartwin.testbed.scanner.scan import ScanTruth, scan
from radartwin.testbed.scanner.sensor import Sensor
from radartwin.testbed.scanner.walk import Walk

__all__ = ["ScanTruth", "Sensor", "Walk", "scan"]
