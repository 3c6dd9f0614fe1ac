"""Write the text embeddings of the objects' descriptions that the package contains: `python -m experiments.generators.anchors`.

Run this script after a description in the object catalogue has changed. The script needs the optional dependencies `text` of the package
(`pip install radartwin[text]`).
"""

from __future__ import annotations

from radartwin.recognize.text import write_shipped
from radartwin.scene.objects.catalogue import catalogue


def main() -> None:
    print(write_shipped([entry.description for entry in catalogue().values()]))


if __name__ == "__main__":
    main()
