"""Write the questions about surface materials again, to which the package has recorded answers of the vision-language model.

    python -m experiments.generators.label_questions lab --out FOLDER
    python -m experiments.generators.label_questions lab --answers FILE --model NAME --about TEXT

The room is scanned as when its answers were recorded (strength 1, seed 0); the chair and the furnished room are real scans. The script
prints for which share of the area a recorded answer has the same hash of question and pictures (pictures differ in single bytes between
types of processors), or is about a surface at the same place. With `--answers`, it replaces the recorded answers.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

from radartwin.commands.demo import SCAN
from radartwin.errors import LabelError
from radartwin.io.one_line import plural
from radartwin.label.labelling import load, prepare
from radartwin.label.question_folder import export, read_answers
from radartwin.label.questions import Question
from radartwin.label.recorded import CHAIR, FURNISHED, SHIPPED, Recorded, ship_records, shipped, shipped_rooms
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.frames.folder import save_frames
from radartwin.scene import rooms
from radartwin.testbed.scanner import scan

DATA = Path("../shared/data/scans") / CHAIR


def asked(room: str, data: Path = DATA) -> list[Question]:
    """Return the questions about a room's scan, or about both forms of the chair scan in the folder `data` (frames and exported mesh)."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        sources = {CHAIR: [data, data / "export.obj"], FURNISHED: [SCAN]}.get(room, [])
        if not sources:
            save_frames(scan(rooms.room(room, detail="cluttered"), 0, 1.0)[0], here / room)
            sources = [here / room]
        questions = []
        for number, source in enumerate(sources):
            scene = here / f"scene_{number}"
            reconstruct(source, scene)
            questions += prepare(scene, load(scene)).questions
        return questions


def exact(room: str, questions: Sequence[Question]) -> float:
    """Return the share of the questions, weighted by surface area, whose text and pictures equal those of the recorded answers."""
    keys = {record.key for record in shipped(room)}
    return _share(questions, {question.id for question in questions if question.key in keys})


def answered(room: str, questions: Sequence[Question]) -> float:
    """Return the share of the questions, by area, with a recorded answer to the same question or about the same place."""
    return _share(questions, {question.id for question, _ in Recorded(shipped(room)).answers(questions)})


def _share(questions: Sequence[Question], ids: set[str]) -> float:
    """Return the share of the surface area of all questions that belongs to the questions with these ids."""
    return sum(q.place.area_m2 for q in questions if q.id in ids) / sum(q.place.area_m2 for q in questions)


def replace_answers(room: str, questions: Sequence[Question], answers: Path, model: str, about: str, to: Path = SHIPPED) -> Path:
    """Replace the recorded answers about a room by those in the file `answers`, and return the path of the written file.

    `model` is the model or person that answered, and `about` states the date and method. Raises LabelError if an answer is invalid or
    missing; the recorded answers are then unchanged.
    """
    records = read_answers(answers, questions, model)
    missing = sorted({question.id for question in questions} - {record.key[:12] for record in records})
    if missing:
        raise LabelError(f"{answers} lacks {len(missing)} of {len(questions)} answers: {', '.join(missing)}; add a line for each")
    return ship_records(records, room, to, about)


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the questions of the recorded answers and compare digests, or record new answers.")
    parser.add_argument("room", choices=shipped_rooms())
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--out", type=Path, help="folder for the questions and their pictures")
    task.add_argument("--answers", type=Path, help="file with new answers, one JSON object per line; needs --model and --about")
    parser.add_argument("--model", help="name of the model or person that gave the new answers")
    parser.add_argument("--about", help="text that states model, date and method of the new answers")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the real chair scan")
    options = parser.parse_args()
    if options.answers and not (options.model and options.about):
        parser.error("--answers needs --model NAME and --about TEXT")
    questions = asked(options.room, options.data)
    if options.answers:
        print(
            f"{replace_answers(options.room, questions, options.answers, options.model, options.about)}: {plural(len(questions), 'answer')}"
        )
        return
    export(questions, options.out)
    same, placed = exact(options.room, questions), answered(options.room, questions)
    shares = f"{placed:.1%} of their area has a recorded answer, {same:.1%} by the same digest"
    print(f"{options.out}: {plural(len(questions), 'question')}; {shares}")


if __name__ == "__main__":
    main()
