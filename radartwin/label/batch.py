"""Questions out as a folder, answers back as a file: for a cluster, a person or any other tool that looks at pictures.

The folder says all there is to know: what to do (README.txt, prompt.txt), the questions (questions.jsonl), their pictures and the form of
an answer (schema_*.json). Names are digests of what is asked: they say nothing of the surface.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radartwin.errors import LabelError, MissingError
from radartwin.io import untrusted_json
from radartwin.io.files import write_atomically
from radartwin.label.answers import Kind, read_answer, schema
from radartwin.label.journal import Record
from radartwin.label.questions import Question, prompt, prompt_digest

QUESTIONS, CROPS = "questions.jsonl", "crops"
SHOWN_PROBLEMS = 20
KINDS: tuple[Kind, ...] = ("surface", "object")

_README = """Questions about what surfaces are made of, to be answered from pictures.

questions.jsonl   one question a line: id, kind, images (pictures, relative to this folder, to be shown in this order) and question (the
                  whole prompt for a vision-language model).
prompt.txt        the two forms of the prompt, for reading.
schema_*.json     the JSON schema of an answer to each kind of question.

Write one JSON object a line into a file, the id of its question and the fields of the answer:
{examples}
Then: radartwin label SCENE --import FILE --model NAME_OF_WHO_ANSWERED
Every line is checked first; nothing is taken unless all lines are good. Prompt {digest}.
"""


def export(questions: Sequence[Question], folder: Path) -> Path:
    """Write the questions and their pictures; questions.jsonl goes last.

    Raises:
        OutputError: the folder cannot be written.
    """
    ordered = sorted(questions, key=lambda question: question.id)
    lines = []
    for question in ordered:
        names = [f"{CROPS}/{question.id}_{number}.jpg" for number in range(1, len(question.crops) + 1)]
        for name, crop in zip(names, question.crops, strict=True):
            write_atomically(folder / name, crop.jpeg)
        entry = {"id": question.id, "kind": question.kind, "images": names, "sha256": list(question.images), "question": question.text}
        lines.append(json.dumps(entry))
    examples: list[dict[str, Any]] = [{"id": "0123456789ab", "material": "wood", "confidence": 0.8, "reason": "...", "name": None}]
    examples.append({**examples[0], "wall_thickness_mm": 1.5, "contents": "empty"})
    shown = "\n".join(f"  {json.dumps(example)}   ({kind})" for example, kind in zip(examples, KINDS, strict=True))
    write_atomically(folder / "README.txt", _README.format(examples=shown, digest=prompt_digest()))
    forms = [f"--- {kind} ---\n" + prompt(kind, "(size, attitude and height of this surface)", ["photo"] * 3) for kind in KINDS]
    write_atomically(folder / "prompt.txt", "\n".join(forms))
    for kind in KINDS:
        write_atomically(folder / f"schema_{kind}.json", json.dumps(schema(kind), indent=1) + "\n")
    write_atomically(folder / QUESTIONS, "".join(line + "\n" for line in lines))
    return folder


def read_answers(path: Path, questions: Sequence[Question], model: str) -> list[Record]:
    """Answers of a JSONL file to these questions.

    A material outside MINC that is known by name is taken as its closest row; there is nobody to ask again.

    Raises:
        MissingError: no such file.
        LabelError: all that is wrong with it, line by line; nothing is taken then.
    """
    if not path.is_file():
        raise MissingError(f"{path} is not there; give the file of answers, one JSON object a line")
    asked = {question.id: question for question in questions}
    found: dict[str, tuple[int, Record]] = {}
    problems = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        if not line.strip():
            continue
        try:
            question, record = _record(line, asked, model)
        except LabelError as error:
            problems.append(f"line {number}: {error}")
            continue
        if question in found:
            problems.append(f"line {number}: {question} was answered in line {found[question][0]}")
        else:
            found[question] = (number, record)
    if problems:
        more = f"; and {len(problems) - SHOWN_PROBLEMS} more" if len(problems) > SHOWN_PROBLEMS else ""
        raise LabelError(f"{path}: nothing is taken, mend {len(problems)} lines: {'; '.join(problems[:SHOWN_PROBLEMS])}{more}")
    return [record for _, record in found.values()]


def _record(line: str, asked: Mapping[str, Question], model: str) -> tuple[str, Record]:
    try:
        values = untrusted_json.load(line)
    except ValueError as error:
        raise LabelError(f"not valid JSON ({error})") from error
    if not isinstance(values, dict) or not isinstance(values.get("id"), str):
        raise LabelError("no object with the id of a question")
    question = asked.get(values.pop("id"))
    if question is None:
        raise LabelError("answers no question of this scene as it is now; export it again if it changed")
    return question.id, Record.of(question, read_answer(values, question.kind, names=True), model, "import")
