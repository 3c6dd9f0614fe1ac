"""Who answers: one Protocol, and the way a model is asked again when its answer is not one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from radartwin.errors import LabelError
from radartwin.label.answers import Answer, read_answer
from radartwin.label.journal import Record
from radartwin.label.questions import Question

TRIES = 3  # answers of one surface before it is `other`


class Provider(Protocol):
    """Questions in, records out as they come; a question it cannot answer is left out.

    Attributes:
        name: "recorded", "server", "local" or whatever the records shall say.
        model: what answers; with the question's key it identifies an answer. None: any model's answers will do.
    """

    @property
    def name(self) -> str: ...

    @property
    def model(self) -> str | None: ...

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]: ...


@dataclass(frozen=True)
class Turn:
    """One turn of a conversation: who ("user" or "assistant") and what; the first user turn goes with the question's pictures."""

    role: str
    text: str


def ask(question: Question, complete: Callable[[list[Turn]], str], tries: int = TRIES) -> Answer:
    """Ask until the answer fits the schema; the complaint goes back each time.

    After the last try a material outside MINC that is known by name is taken as its closest row; anything else becomes `other`.

    Args:
        complete: the conversation so far to the model's next words.
    """
    turns = [Turn("user", question.text)]
    said, problem = "", ""
    for attempt in range(1, tries + 1):
        said = complete(turns)
        try:
            answer = read_answer(said, question.kind, names=attempt == tries)
        except LabelError as error:
            problem = str(error)
            again = f"That is not a valid answer: {problem[:500]}. Answer again, with one JSON object of the asked form and nothing else."
            turns += [Turn("assistant", said[:2000]), Turn("user", again)]
            continue
        return Answer(**{**answer.to_dict(), "attempts": attempt})
    return Answer.none(problem, tries)
