"""Write the scan of `radartwin demo`: `python -m experiments.generators.demo_scan ../shared/data/scans/cc0_furnished_room/room.glb`.

The script keeps the triangles of a .glb and reduces its pictures to SCALE of their width and height, so that the file is below 1 MB.
"""

import sys
from pathlib import Path

from experiments.generators.glb_pictures import with_jpeg
from radartwin.commands.demo import SCAN
from radartwin.io.files import write_atomically

SCALE, QUALITY = 0.375, 60  # of the pictures


if __name__ == "__main__":
    print(write_atomically(SCAN, with_jpeg(Path(sys.argv[1]).read_bytes(), SCALE, QUALITY)))
