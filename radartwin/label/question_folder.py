"""Write the material questions to a folder and read answers from a file, so that a cluster, a person or another tool can answer them.

The question folder is self-contained: it holds instructions (README.txt, prompt.txt), the questions (questions.jsonl), their pictures and
the JSON schema of an answer (schema_*.json). File names in the question folder are digests of the questions, so that the file names do not
reveal the names of the surfaces.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radartwin.errors import LabelError
from radartwin.io import untrusted_json
from radartwin.io.files import write_atomically
from radartwin.io.one_line import plural
from radartwin.label.answers import Kind, read_answer, schema
from radartwin.label.journal import Record
from radartwin.label.questions import Question, prompt, prompt_digest

QUESTIONS, CROPS = "questions.jsonl", "crops"
SHOWN_PROBLEMS = 20
KINDS: tuple[Kind, ...] = ("surface", "object")

_README = """Questions about the materials of surfaces, to be answered from pictures.

questions.jsonl   one question per line: id, kind, images (pictures in this order, relative to this folder) and question (the complete
                  prompt for a vision-language model).
prompt.txt        both forms of the prompt, for reading.
schema_*.json     the JSON schema of an answer to each kind of question.

Write a file with one JSON object per line, with the id of a question and the fields of the answer:
{examples}
Then run: radartwin label SCENE --import FILE --model NAME
NAME is the model or person that answered. If one line is invalid, no answer is imported. Prompt {digest}.
"""


def export(questions: Sequence[Question], folder: Path) -> Path:
    """Write the material questions and their pictures to a folder. The file questions.jsonl is written last."""
    ordered = sorted(questions, key=lambda question: question.id)
    lines = []
    for question in ordered:
        names = [f"{CROPS}/{question.id}_{number}.jpg" for number in range(1, len(question.crops) + 1)]
        for name, crop in zip(names, question.crops, strict=True):
            write_atomically(folder / name, crop.jpeg)
        entry = {"id": question.id, "kind": question.kind, "images": names, "sha256": list(question.images), "question": question.text}
        lines.append(json.dumps(entry))
    example = {"id": "0123456789ab", "material": "wood", "finish": "smooth", "confidence": 0.8, "reason": "...", "name": None}
    examples: list[dict[str, Any]] = [example, {**example, "wall_thickness_mm": 1.5, "contents": "empty"}]
    example_lines = "\n".join(f"  {json.dumps(example)}   ({kind})" for example, kind in zip(examples, KINDS, strict=True))
    write_atomically(folder / "README.txt", _README.format(examples=example_lines, digest=prompt_digest()))
    forms = [f"--- {kind} ---\n" + prompt(kind, "(size, attitude and height of this surface)", ["photo"] * 3) for kind in KINDS]
    write_atomically(folder / "prompt.txt", "\n".join(forms))
    for kind in KINDS:
        write_atomically(folder / f"schema_{kind}.json", json.dumps(schema(kind), indent=1) + "\n")
    write_atomically(folder / QUESTIONS, "".join(line + "\n" for line in lines))
    return folder


def read_answers(path: Path, questions: Sequence[Question], model: str) -> list[Record]:
    """Read the answers to `questions` from a JSONL file. If the file has invalid lines, raise a LabelError that counts them and names
    the first SHOWN_PROBLEMS.

    A known material outside the MINC categories is replaced by its closest MINC category, because the question cannot be asked again.
    """
    by_id = {question.id: question for question in questions}
    records: dict[str, tuple[int, Record]] = {}
    problems = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        if not line.strip():
            continue
        try:
            question, record = _record(line, by_id, model)
        except LabelError as error:
            problems.append(f"line {number}: {error}")
            continue
        if question in records:
            problems.append(f"line {number}: {question} already has an answer in line {records[question][0]}")
        else:
            records[question] = (number, record)
    if problems:
        more = f"; and {len(problems) - SHOWN_PROBLEMS} more" if len(problems) > SHOWN_PROBLEMS else ""
        raise LabelError(
            f"{path}: no answer is imported; correct {plural(len(problems), 'line')}: {'; '.join(problems[:SHOWN_PROBLEMS])}{more}"
        )
    return [record for _, record in records.values()]


def _record(line: str, by_id: Mapping[str, Question], model: str) -> tuple[str, Record]:
    try:
        values = untrusted_json.load(line)
    except ValueError as error:
        raise LabelError(f"not valid JSON ({error})") from error
    if not isinstance(values, dict) or not isinstance(values.get("id"), str):
        raise LabelError("not an object with the id of a question")
    question = by_id.get(values.pop("id"))
    if question is None:
        raise LabelError("the id is not a question of this scene; export the scene again if it changed")
    return question.id, Record.of(question, read_answer(values, question.kind, names=True), model, "import")
