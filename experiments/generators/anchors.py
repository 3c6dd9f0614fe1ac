"""Write the package's text anchors (text embeddings of the objects' descriptions): `python -m experiments.generators.anchors`.

Run this script after a description in the catalogue changes. It needs the extra `text`.
"""

from __future__ import annotations

from radartwin.recognize.text import write_shipped
from radartwin.scene.objects.catalogue import catalogue


def main() -> None:
    print(write_shipped([entry.description for entry in catalogue().values()]))


if __name__ == "__main__":
    main()
