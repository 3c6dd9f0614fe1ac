"""Write the model card of a recogniser: what it was trained on, its accuracy in simulation, how to use it, and what it cannot do."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from radartwin.constants import __version__
from radartwin.recognize.own.fitting import HeldOut
from radartwin.recognize.own.object_list import OwnObject

CARD, FREE_SPACE = "README.md", "free space"
WIDTH = 120  # characters per line of the model card


@dataclass(frozen=True)
class TrainedOn:
    """The simulation that a recogniser was trained on.

    Attributes:
        radar: name of the radar option, or of the radar file.
        radar_settings: all settings of the radar, as plain values.
        surroundings: the room around the object, as text; FREE_SPACE if there is none.
        frames: number of frames per revolution.
        period_s: duration of one revolution in seconds.
        copies: number of copies of each simulated revolution.
        variants: number of drawn turntables and objects, over which the copies are divided.
        randomise: strength of the randomisation of each quantity (radartwin.recognize.randomise).
        described: whether the class vectors are the text embeddings of the objects' descriptions.
    """

    radar: str
    radar_settings: Mapping[str, Any]
    surroundings: str
    simulator: str
    distances_m: tuple[float, ...]
    frames: int
    period_s: float
    copies: int
    variants: int
    randomise: Mapping[str, float]
    seed: int
    recordings: int
    described: bool


def model_card(objects: Sequence[OwnObject], trained: TrainedOn, epochs: int, tested: HeldOut | None) -> str:
    """Return the model card as Markdown text.

    Args:
        tested: answers at held-out distances; None if the training has a single distance.
    """
    objects_head = ("class", "mesh or catalogue object", "material", "size in mm", "description")
    described = [
        (own_object.name, own_object.origin, own_object.material, _size(own_object), own_object.description or "none")
        for own_object in objects
    ]
    lines = [
        f"# Recogniser of {len(objects)} objects",
        "",
        *_paragraph(f"RadarTwin {__version__} trained this recogniser on simulated radar recordings only. No measured recording was used."),
        "## Objects",
        *_table(objects_head, described),
        "## Training data",
        *_table(("quantity", "value"), _training(trained, epochs)),
        "## Accuracy in simulation",
        *_accuracy(tested, trained),
        "## Use",
        *_paragraph(
            "Put one of the objects on a turntable in front of the radar, with the radar at the height of the object's middle. "
            "Record at least one whole revolution. `FOLDER` is the folder of this file. `--distance` is the distance in metres from the "
            "radar to the axis of the turntable, and `--period` is the duration of a revolution in seconds."
        ),
        "```",
        f"radartwin classify RECORDING --model FOLDER --distance {trained.distances_m[0]:g} --period {trained.period_s:g}",
        "```",
        "",
        "## Limits",
        *(line for limit in _limits(trained) for line in textwrap.wrap(f"- {limit}", WIDTH, subsequent_indent="  ")),
    ]
    return "\n".join(lines) + "\n"


def _training(trained: TrainedOn, epochs: int) -> list[tuple[str, str]]:
    vectors = "text embeddings of the descriptions (MiniLM-L6-v2)" if trained.described else "orthonormal vectors, without text"
    return [
        ("radar", trained.radar),
        ("surroundings", trained.surroundings),
        ("simulator", trained.simulator),
        ("distances from the radar to the axis", ", ".join(f"{d:g} m" for d in trained.distances_m)),
        ("frames per revolution", str(trained.frames)),
        ("duration of a revolution", f"{trained.period_s:g} s"),
        ("simulated recordings, one revolution each", str(trained.recordings)),
        ("copies of each recording", str(trained.copies)),
        ("drawn at random in the copies (factors on the ranges)", _randomised(trained)),
        ("features", "rotation without brightness"),
        ("class vectors", vectors),
        ("seed", str(trained.seed)),
        ("epochs", str(epochs)),
    ]


def _accuracy(tested: HeldOut | None, trained: TrainedOn) -> list[str]:
    if tested is None:
        return _paragraph(
            "The accuracy is not known. All recordings have the same distance, so no distance could be held out. Train at two or more "
            "distances to get a figure."
        )
    per_distance = [(distance, f"{share:.1%}") for distance, share in tested.by_distance.items()]
    total = tested.counts.sum(axis=0)
    rows = [(name, *map(str, counts)) for name, counts in zip(tested.classes, total.tolist(), strict=True)]
    return [
        *_paragraph(
            "**The figures of this section are from simulation, not from reality.** For each distance, RadarTwin trained a recogniser "
            "on all other distances. This recogniser then classified the copies at the left-out distance. There are "
            f"{tested.revolutions} copies of {trained.recordings} simulated revolutions. The copies of one revolution are similar, so the "
            f"figures are as uncertain as those of a test with {trained.recordings} recordings."
        ),
        *_paragraph(f"The accuracy is {tested.accuracy:.1%}, and chance is {1 / len(tested.classes):.1%}."),
        *_table(("held-out distance", "accuracy"), per_distance),
        *_paragraph("The table gives the number of copies by true class (rows) and by answer of the recogniser (columns)."),
        *_table(("true class", *tested.classes), rows),
    ]


def _limits(trained: TrainedOn) -> list[str]:
    free = "The simulation had no room, so the training contains no echoes of walls and furniture near the object."
    room = "The simulation had one room. In another room, or at another place in this room, the echoes near the object differ."
    return [
        "The difference between simulation and measurement (the domain gap) is unknown for these objects. No figure of this file is about "
        "measurements. Test the recogniser on your own labelled recordings before you rely on an answer.",
        "The recogniser always answers with one of its objects. It cannot say that an object is none of them.",
        "It works for an object that turns on a turntable, once or more, at constant speed. It does not work for other motions.",
        f"It was trained for one radar ({trained.radar}). Other radars have other antennas and range bins, which change the features.",
        "The range gate, 0.13 m on either side of the object, must contain one object only.",
        "It does not use the absolute level of the echo, so it cannot separate objects that differ only in level.",
        free if trained.surroundings == FREE_SPACE else room,
        "The simulated objects are the meshes and materials that the table above states. Labels, caps, dents and fill levels are missing "
        "unless the meshes contain them.",
    ]


def _randomised(trained: TrainedOn) -> str:
    drawn = ", ".join(f"{name} {strength:g}" for name, strength in trained.randomise.items() if strength)
    return f"{drawn}; {trained.variants} random sets of turntable and object errors per revolution" if drawn else "nothing but noise"


def _size(own_object: OwnObject) -> str:
    return " x ".join(f"{1000 * extent:.0f}" for extent in own_object.size_m)


def _paragraph(text: str) -> list[str]:
    return [*textwrap.wrap(text, WIDTH), ""]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table. A vertical bar in a cell is escaped, and a line break becomes a space."""
    cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    return [*(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *cells)), ""]
