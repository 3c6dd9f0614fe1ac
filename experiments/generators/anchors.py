"""Write the text embeddings of the objects' descriptions that the package contains: `python -m experiments.generators.anchors`.

Run it after a description of an object's look or radar echo in the catalogue has changed; the other embeddings stay. It needs `pip install
radartwin[text]`, and prints the largest cosine between the embeddings of two objects, for each kind of description.
"""

import numpy as np

from radartwin.recognize.text import embed, write_shipped
from radartwin.scene.objects.assortment import every_object


def main() -> None:
    entries = every_object().values()
    kinds = {
        "look": [entry.description for entry in entries],
        "radar echo": [entry.radar_description for entry in entries if entry.radar_description],
    }
    print(write_shipped([text for texts in kinds.values() for text in texts]))
    for kind, texts in kinds.items():
        cosines = np.triu(embed(texts) @ embed(texts).T, k=1)
        print(f"{kind}: the largest cosine of two objects is {cosines.max():.3f}")


if __name__ == "__main__":
    main()
