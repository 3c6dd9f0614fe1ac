"""A scene folder is labelled: pictures, questions, answers kept as they come, materials into the manifest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from radartwin.errors import ConfigError, MissingError, SceneError
from radartwin.io.files import check_folder, lock
from radartwin.io.progress import Progress
from radartwin.label.batch import export, read_answers
from radartwin.label.journal import Journal, Record
from radartwin.label.labels import Label, belongs_to_room, labelled
from radartwin.label.manifest import MANIFEST, write_labels
from radartwin.label.photos import load_photos
from radartwin.label.provider import Provider
from radartwin.label.questions import Question, questions
from radartwin.label.recorded import JOURNAL, Recorded, records_for
from radartwin.label.server import DEFAULT_MODEL, DEFAULT_URL, Server
from radartwin.label.sources import Uniform
from radartwin.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Asked:
    """A scene folder with its questions.

    Attributes:
        surfaces: indices that are to be labelled; those no view shows have no question.
    """

    folder: Path
    scene: Scene
    surfaces: tuple[int, ...]
    questions: tuple[Question, ...]


@dataclass(frozen=True)
class Wishes:
    """How a scene folder is to be labelled: what `radartwin label` takes.

    Attributes:
        provider: "recorded", "server" or "local".
        model: whose answers; None takes the provider's default, or any recorded ones. Needed with `answers`.
        url, timeout_s, concurrency: of the server.
        export: write the questions into this folder instead.
        answers: take the answers of this file instead.
        missing: "uniform:MATERIAL" for surfaces without an answer; None refuses them.
        views: pictures of each surface.
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


def label_folder(folder: Path, wishes: Wishes, progress: Progress | None = None) -> list[str]:
    """Label a scene folder, or write its questions.

    Returns:
        Lines that say what was done: a table of the labels, or where the questions are.
    Raises:
        UserError: see `prepare`, `answer`, `import_answers`, `apply`.
    """
    missing = _missing(wishes.missing)
    if wishes.answers is not None and not wishes.model:
        raise ConfigError("--import needs --model NAME: the name of who answered is kept with the answers")
    if wishes.answers is not None and not wishes.answers.is_file():
        raise MissingError(f"{wishes.answers} is not there; give the file of answers, one JSON object a line")
    if wishes.export is not None:
        check_folder(wishes.export)
    scene = load(folder)
    provider = _provider(folder, scene, wishes) if wishes.export is None and wishes.answers is None else None
    asked = prepare(folder, scene, views=wishes.views, progress=progress)
    if wishes.export is not None:
        export(asked.questions, wishes.export)
        unseen = len(asked.surfaces) - len(asked.questions)
        return [f"{wishes.export}: {len(asked.questions)} questions" + (f"; {unseen} surfaces are seen from nowhere" if unseen else "")]
    if provider is None:
        assert wishes.answers is not None
        found = import_answers(asked, wishes.answers, str(wishes.model))
    else:
        found = answer(asked, provider, progress)
    return summary(apply(asked, found, missing))


def _provider(folder: Path, scene: Scene, wishes: Wishes) -> Provider:
    if wishes.provider == "server":
        return Server(wishes.model or DEFAULT_MODEL, wishes.url, timeout_s=wishes.timeout_s, concurrency=wishes.concurrency)
    if wishes.provider == "local":
        from radartwin.label.local import Local

        return Local(wishes.model)
    return Recorded(records_for(scene, folder), wishes.model)


def _missing(text: str | None) -> Label | None:
    if text is None:
        return None
    source, _, material = text.partition(":")
    if source != Uniform.name or not material:
        raise ConfigError(f"--missing {text} is not known; give uniform:MATERIAL, for example uniform:plasterboard")
    return Uniform(material).label()


def load(folder: Path) -> Scene:
    """The scene of a folder that can take labels.

    Raises:
        MissingError, SceneError: no scene folder; nothing in it.
    """
    if not (folder / MANIFEST).is_file():
        raise MissingError(f"{folder} is not a scene folder (it has no {MANIFEST}); make one with radartwin reconstruct SCAN --out FOLDER")
    scene = Scene.load(folder)
    if not any(belongs_to_room(surface) for surface in scene):
        raise SceneError(f"{folder}: the scene has no surfaces of a room, so there is nothing to label")
    return scene


def prepare(folder: Path, scene: Scene, *, views: int = 3, progress: Progress | None = None) -> Asked:
    """Make the question of each surface that is to be labelled.

    Raises:
        InputError: the photographs beside the scene.
    """
    photos = load_photos(folder)
    surfaces = [index for index, surface in enumerate(scene) if belongs_to_room(surface)]
    with (progress or Progress(quiet=True)).task(f"views of {len(surfaces)} surfaces", len(surfaces)) as advance:
        asked = questions(scene, photos, views=views, only=surfaces, step=advance)
    return Asked(folder, scene, tuple(surfaces), tuple(asked))


def answer(asked: Asked, provider: Provider, progress: Progress | None = None) -> dict[int, Record]:
    """Answers by surface index: those kept from before first, then the provider's, each kept at once.

    Raises:
        BackendError: the provider could not answer all; what it did answer is kept.
    """
    progress = progress or Progress(quiet=True)
    path = asked.folder / JOURNAL
    with lock(path.with_suffix(".lock"), lambda: progress.say(f"{asked.folder} is being labelled by another process; waiting")):
        journal = Journal(path)
        found = {}
        for question in asked.questions:
            kept = journal.get(provider.model, question.key) if provider.model else None
            if kept is not None:
                found[question.surface] = kept
        left = [question for question in asked.questions if question.surface not in found]
        if found and left:
            progress.say(f"{len(found)} of {len(asked.questions)} answers are kept from before")
        if left:
            with progress.task(f"asking {provider.name} {provider.model or ''}".rstrip(), len(left)) as advance:
                for question, record in provider.answers(left):
                    if record.key == question.key and not isinstance(provider, Recorded):
                        journal.append(record)
                    found[question.surface] = record
                    advance()
    return found


def import_answers(asked: Asked, path: Path, model: str) -> dict[int, Record]:
    """Answers of a file, checked as a whole, kept and returned by surface index.

    Raises:
        MissingError, LabelError: the file; nothing is kept then.
    """
    records = {record.key: record for record in read_answers(path, asked.questions, model)}
    journal_path = asked.folder / JOURNAL
    with lock(journal_path.with_suffix(".lock")):
        journal = Journal(journal_path)
        for record in records.values():
            journal.append(record)
    return {question.surface: records[question.key] for question in asked.questions if question.key in records}


def apply(asked: Asked, found: dict[int, Record], missing: Label | None = None) -> Scene:
    """Put the answers on the scene and into its manifest.

    Raises:
        LabelError: surfaces without answer and no `missing`; the manifest stays as it was.
    """
    keys = {question.surface: question.key for question in asked.questions}
    scene = labelled(asked.scene, found, asked.surfaces, missing, transferred=lambda index: found[index].key != keys.get(index))
    write_labels(asked.folder, scene)
    return scene


def summary(scene: Scene) -> list[str]:
    """A table in lines: surface, material, category, confidence, stand-in, and a last line that counts."""
    from radartwin.scene.viewer.page import material_label

    rows: list[Sequence[str]] = [("surface", "material", "MINC", "confidence", "stand-in", "from")]
    for surface in scene:
        told = surface.provenance
        confidence = told.get("confidence")
        notes = [
            str(told.get("model") or told.get("source", "")),
            *(word for word in ("transferred", "missing", "invalid") if told.get(word)),
        ]
        rows.append(
            (
                surface.name,
                material_label(surface.material),
                str(told.get("minc") or "-"),
                "-" if confidence is None else f"{confidence:.2f}",
                "yes" if told.get("stand_in") else "no",
                ", ".join(notes),
            )
        )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return [*lines, _counts(scene)]


def _counts(scene: Scene) -> str:
    def count(surfaces: Iterable[bool]) -> int:
        return sum(surfaces)

    invalid = count(bool(s.provenance.get("invalid")) for s in scene)
    missing = count(bool(s.provenance.get("missing")) for s in scene)
    stand_ins = count(bool(s.provenance.get("stand_in")) for s in scene)
    return f"{len(scene)} surfaces labelled, {stand_ins} with a stand-in, {missing} without an answer, {invalid} without a valid one"
