"""Implement `radartwin label`: ask for the materials of the surfaces of a scene, store the answers, and write the materials to the
manifest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from radartwin.errors import ConfigError, MissingError, SceneError
from radartwin.io.chat import KEY_VARIABLE
from radartwin.io.files import check_folder, lock
from radartwin.io.one_line import plural
from radartwin.io.progress import Progress
from radartwin.label.journal import Journal, Record
from radartwin.label.material_sources import Uniform
from radartwin.label.photos import load_photos, load_textured
from radartwin.label.question_folder import export, read_answers
from radartwin.label.questions import Question, questions
from radartwin.label.recorded import JOURNAL, Recorded, records_for
from radartwin.label.server import DEFAULT_MODEL, DEFAULT_URL, Server
from radartwin.label.surface_labels import Label, belongs_to_room, labelled, write_labels
from radartwin.scene.scene import Scene
from radartwin.scene.storage import MANIFEST


class Provider(Protocol):
    """A source of answers to material questions, such as a server with a vision-language model.

    The attribute `model` is None if the answers may come from any model. The method `answers` yields each answered question with the record
    of its answer, in any order. Questions without an answer are left out.
    """

    @property
    def name(self) -> str: ...

    @property
    def model(self) -> str | None: ...

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]: ...


@dataclass(frozen=True, eq=False)
class LabelTask:
    """The material questions about a scene folder.

    `surfaces` holds the indices of the surfaces to label; some may be visible in no picture.
    """

    folder: Path
    scene: Scene
    surfaces: tuple[int, ...]
    questions: tuple[Question, ...]


@dataclass(frozen=True)
class LabelOptions:
    """The options of the command `radartwin label`.

    Attributes:
        provider: "recorded" uses stored answers, "server" a model on a server, "local" the model InternVL on this machine.
        model: name of the vision-language model that answers; None means the default model for "server" and the stored answers of any model
            for "recorded". "local" and the option `answers` need a model name.
        url: address of the server of the vision-language model.
        timeout_s: time limit of one request to the server, in seconds.
        concurrency: number of requests that are sent to the server in parallel.
        export: folder to which the questions are written; no surface is then labelled. None labels the surfaces.
        answers: file with answers to the questions, used instead of the provider; None uses the provider.
        missing: "uniform:MATERIAL" gives this material to surfaces without an answer; None makes a surface without an answer an error.
        views: largest number of pictures of each surface in its question.
    Raises:
        ConfigError: `views` or `concurrency` is below 1, `timeout_s` is not above zero and finite, or `url` contains a password, which the
            process list and the history of the shell would show.
    """

    provider: str = "recorded"
    model: str | None = None
    url: str = DEFAULT_URL
    timeout_s: float = 120.0
    concurrency: int = 4
    export: Path | None = None
    answers: Path | None = None
    missing: str | None = None
    views: int = 3

    def __post_init__(self) -> None:
        for name in ("views", "concurrency"):
            if getattr(self, name) < 1:
                raise ConfigError(f"--{name} {getattr(self, name)} is below 1; give --{name} 1 or more")
        if not 0 < self.timeout_s < math.inf:
            raise ConfigError(f"--timeout {self.timeout_s:g} is not a time limit; give seconds above zero")
        if re.match(r"[\w+.-]+://[^/?#]*@", self.url):
            raise ConfigError(f"--url contains a user name or password, which other users of this machine see; set {KEY_VARIABLE} instead")


def label_folder(folder: Path, options: LabelOptions, progress: Progress | None = None) -> list[str]:
    """Write a material for each surface of a scene folder into its manifest, or export the questions about the materials.

    Args:
        folder: a scene folder, such as one that `radartwin reconstruct` wrote.
        options: who answers the questions, or where the questions or answers are; see `LabelOptions`.
        progress: display that shows the steps; None shows nothing.
    Returns:
        The lines that the command `radartwin label` prints.
    Raises:
        ConfigError, MissingError, SceneError: an option is wrong, a file is missing, or the folder holds no scene.
    """
    missing = _missing_label(options.missing)
    if options.answers is not None and not options.model:
        raise ConfigError("--import needs --model NAME, the model or person that answered")
    if options.answers is not None and not options.answers.is_file():
        raise MissingError(f"{options.answers} is missing; give the file of answers with one JSON object per line")
    if options.export is not None:
        check_folder(options.export)
    scene = load(folder)
    provider = _provider(folder, scene, options) if options.export is None and options.answers is None else None
    task = prepare(folder, scene, views=options.views, progress=progress)
    if options.export is not None:
        export(task.questions, options.export)
        unseen = len(task.surfaces) - len(task.questions)
        return [
            f"{options.export}: {plural(len(task.questions), 'question')}"
            + (f"; no view shows {plural(unseen, 'surface')}" if unseen else "")
        ]
    if provider is None:
        assert options.answers is not None
        records = import_answers(task, options.answers, str(options.model))
    else:
        records = answer(task, provider, progress)
    return summary(apply(task, records, missing))


def _provider(folder: Path, scene: Scene, options: LabelOptions) -> Provider:
    if options.provider == "server":
        return Server(options.url, options.model or DEFAULT_MODEL, options.timeout_s, concurrency=options.concurrency)
    if options.provider == "local":
        from radartwin.label.internvl import InternVL  # imports PyTorch

        return InternVL(options.model)
    return Recorded(records_for(scene, folder), options.model)


def _missing_label(text: str | None) -> Label | None:
    if text is None:
        return None
    source, _, material = text.partition(":")
    if source != Uniform.name or not material:
        raise ConfigError(f"--missing {text} is unknown; give uniform:MATERIAL, for example uniform:plasterboard")
    return Uniform(material).label()


def load(folder: Path) -> Scene:
    """Load the scene of a scene folder. The scene must have surfaces of a room."""
    if not (folder / MANIFEST).is_file():
        raise MissingError(f"{folder} is not a scene folder (it has no {MANIFEST}); make one with radartwin reconstruct SCAN --out FOLDER")
    scene = Scene.load(folder)
    if not any(belongs_to_room(surface) for surface in scene):
        raise SceneError(f"{folder}: the scene has no surfaces of a room to label; reconstruct a scan of a room")
    return scene


def prepare(folder: Path, scene: Scene, *, views: int = 3, progress: Progress | None = None) -> LabelTask:
    """Prepare the material questions about all surfaces of a scene that need a material label."""
    photos = load_photos(folder)
    surfaces = tuple(index for index, surface in enumerate(scene) if belongs_to_room(surface))
    with (progress or Progress(quiet=True)).task(f"views of {plural(len(surfaces), 'surface')}", len(surfaces)) as advance:
        asked = questions(scene, photos, load_textured(folder), views=views, only=surfaces, step=advance)
        return LabelTask(folder, scene, surfaces, tuple(asked))


def answer(task: LabelTask, provider: Provider, progress: Progress | None = None) -> dict[int, Record]:
    """Return the record of each surface's answer by surface index. Stored answers are reused, and the provider answers all other questions.

    Each answer of the provider is stored as soon as it arrives, so it is kept even if a later question raises an error.
    """
    progress = progress or Progress(quiet=True)
    path = task.folder / JOURNAL
    with lock(path.with_suffix(".lock"), lambda: progress.say(f"another process labels {task.folder}; waiting")):
        journal = Journal(path)
        records = {}
        for question in task.questions:
            stored = journal.get(provider.model, question.key) if provider.model else None
            if stored is not None:
                records[question.surface] = stored
        open_questions = [question for question in task.questions if question.surface not in records]
        if records and open_questions:
            progress.say(f"{len(records)} of {len(task.questions)} answers are already stored")
        if open_questions:
            with progress.task(f"asking {provider.name} {provider.model or ''}".rstrip(), len(open_questions)) as advance:
                for question, record in provider.answers(open_questions):
                    if record.key == question.key and not isinstance(provider, Recorded):
                        journal.append(record)
                    records[question.surface] = record
                    advance()
    return records


def import_answers(task: LabelTask, path: Path, model: str) -> dict[int, Record]:
    """Read the answers to the material questions from a file, and return their records by surface index.

    The answers are stored in the scene folder only if every line of the file is valid.
    """
    records = {record.key: record for record in read_answers(path, task.questions, model)}
    journal_path = task.folder / JOURNAL
    with lock(journal_path.with_suffix(".lock")):
        journal = Journal(journal_path)
        for record in records.values():
            journal.append(record)
    return {question.surface: records[question.key] for question in task.questions if question.key in records}


def apply(task: LabelTask, records: dict[int, Record], missing: Label | None = None) -> Scene:
    """Set the surface materials of a scene from the answers, and write the materials to the scene's manifest.

    Raises:
        LabelError: a surface has no answer, and `missing` is None.
        SceneError: the manifest in the scene folder now lists other surfaces.
    """
    keys = {question.surface: question.key for question in task.questions}
    scene = labelled(task.scene, records, task.surfaces, missing, transferred=lambda index: records[index].key != keys.get(index))
    write_labels(task.folder, scene)
    return scene


def summary(scene: Scene) -> list[str]:
    """Return a text table with one line for each labelled surface and a last line with the totals."""
    from radartwin.scene.viewer.page import material_label

    rows: list[Sequence[str]] = [("surface", "material", "MINC", "confidence", "substitute", "from")]
    for surface in scene:
        facts = surface.provenance
        confidence = "-" if facts.get("confidence") is None else f"{facts['confidence']:.2f}"
        stand_in = "yes" if facts.get("stand_in") else "no"
        origin = [str(facts.get("model") or facts.get("source", ""))]
        origin += [key for key in ("transferred", "missing", "invalid") if facts.get(key)]
        material = material_label(surface.material)
        rows.append((surface.name, material, str(facts.get("minc") or "-"), confidence, stand_in, ", ".join(origin)))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    stand_ins, missing, invalid = (sum(bool(s.provenance.get(key)) for s in scene) for key in ("stand_in", "missing", "invalid"))
    total = f"{plural(len(scene), 'surface')} labelled, {stand_ins} with a substitute, {missing} without an answer, "
    return [*lines, f"{total}{invalid} with an invalid answer"]
