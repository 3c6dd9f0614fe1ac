"""Convert simple English sentences to object layouts with a fixed grammar. Three examples follow.

    a mug on the table 1.5 m in front of the door
    put the corner reflector 2 m in front of the radar, and a can 30 cm left of it
    a crate under the desk turned by 45 degrees

A sentence is a list of objects joined by "and", commas or full stops. Each object is a name from the object catalogue, followed by phrases
such as `on THING`, `[DISTANCE] RELATION THING`, or `turned by ANGLE degrees`. A sentence with any other word raises an error.
"""

from __future__ import annotations

import re
from dataclasses import replace

from radartwin.errors import LayoutError
from radartwin.scene.layouts.layout import Item, Layout, Relation, check_places

READS = (
    "'OBJECT on THING' and 'OBJECT [1.5 m | 30 cm] in front of | behind | left of | right of | beside | under THING', "
    "several of them joined by 'and'"
)
_RELATIONS = {
    "in front of": "in front of", "before": "in front of", "behind": "behind", "in back of": "behind",
    "to the left of": "left of", "on the left of": "left of", "left of": "left of",
    "to the right of": "right of", "on the right of": "right of", "right of": "right of",
    "beside": "beside", "next to": "beside", "near": "beside",
    "under": "under", "underneath": "under", "beneath": "under", "below": "under",
    "on top of": "on", "upon": "on", "onto": "on", "on": "on",
}  # fmt: skip
_UNITS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01, "mm": 0.001, "millimetre": 0.001,
          "millimeter": 0.001}  # fmt: skip
_NUMBERS = {"half a": 0.5, "one and a half": 1.5, "a": 1.0, "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0}

_NUMBER = r"(?:\d+(?:[.,]\d+)?|" + "|".join(sorted(_NUMBERS, key=len, reverse=True)) + r")"
_DISTANCE = rf"(?P<number>{_NUMBER})\s*(?P<unit>" + "|".join(sorted(_UNITS, key=len, reverse=True)) + r")s?\b"
_RELATION = r"(?P<relation>" + "|".join(sorted(_RELATIONS, key=len, reverse=True)) + r")\b"
_PHRASE = re.compile(rf"\b(?:{_DISTANCE}\s+)?{_RELATION}|\b(?:turned|rotated)(?: by)?\s+(?P<yaw>-?\d+(?:\.\d+)?)\s*(?:degrees?|deg|°)")
_START = re.compile(r"^(?:please\s+)?(?:(?:put|place|set|stand|add)\s+|there is\s+|with\s+)?(?:(?:a|an|the|one|another)\s+)?")
_JOINTS = re.compile(r"\s*(?:[,;]\s*and\b|[,;](?!\d)|\.(?=\s|$)|\band\b)\s*")
_PRONOUNS = {"it", "that", "this"}


def parse(sentence: str) -> Layout:
    """Convert an English sentence to an object layout.

    Raises:
        LayoutError: the grammar does not cover a part of the sentence; the message names this part and the supported phrases.
    """
    sentence = " ".join(sentence.split())
    text = sentence.lower().replace("one and a half", "1.5").replace("a half metre", "0.5 m")
    items: list[Item] = []
    for clause in filter(None, _JOINTS.split(text)):
        phrases = list(_PHRASE.finditer(clause))
        start = _START.match(clause)
        assert start is not None  # the pattern also matches the empty string
        head = clause[: phrases[0].start()].strip() if phrases else clause
        subject = head[start.end() :].strip() if len(head) > start.end() else ""
        if not subject:
            if not items or not phrases or head:
                raise _refusal(sentence, f"'{clause}' names no object")
            items[-1] = _with(items[-1], clause, phrases, items, len(items) - 1, sentence)  # "... and 1 m in front of the door"
            continue
        if not phrases:
            raise _refusal(sentence, f"'{clause}' gives no place")
        _check_subject(subject, sentence)
        if re.search(r"\d", _plain(subject)):
            raise _refusal(sentence, f"the number in '{subject}' has no unit, or no relation after it")
        items.append(_with(Item(subject), clause, phrases, items, len(items), sentence))
    if not items:
        raise _refusal(sentence, "it is empty")
    check_places(items, f"'{sentence}'")
    return Layout(tuple(items))


def _with(item: Item, clause: str, phrases: list[re.Match[str]], items: list[Item], index: int, sentence: str) -> Item:
    """Return `item`, number `index` in `items`, with the support, relations and rotation of a clause. "it" means the preceding object."""
    for phrase, following in zip(phrases, [*phrases[1:], None], strict=True):
        thing = clause[phrase.end() : following.start() if following else len(clause)].strip()
        if phrase["yaw"] is not None:
            if thing:
                raise _refusal(sentence, f"'{thing}' after the angle is not understood")
            item = replace(item, yaw_deg=float(phrase["yaw"]))
            continue
        anchor = re.sub(r"^(?:the|a|an)\s+", "", thing)
        if not anchor:
            raise _refusal(sentence, f"'{phrase[0].strip()}' is not followed by a name")
        if re.search(r"\d", _plain(anchor)) or re.search(r"\b(?:from|away|between|with|at|of|inside|in|against|above|over)\b", anchor):
            raise _refusal(sentence, f"'{anchor}' is not understood as the name of a thing")
        if anchor in _PRONOUNS:
            anchor = _named(items, index - 1, anchor, sentence)
        relation = _RELATIONS[phrase["relation"]]
        if relation == "on":
            if phrase["number"] is not None:
                raise _refusal(sentence, f"'{phrase[0].strip()}' has a distance, but 'on' takes none")
            if item.on is not None:
                raise _refusal(sentence, f"the {item.object} is on two things")
            item = replace(item, on=anchor)
        else:
            item = replace(item, relations=(*item.relations, Relation(relation, anchor, _metres(phrase))))
    return item


def _named(items: list[Item], index: int, pronoun: str, sentence: str) -> str:
    """Return the name of the object to which a pronoun refers. An object without a name gets a name first."""
    if index < 0:
        raise _refusal(sentence, f"'{pronoun}' refers to no object before it")
    if not items[index].name:
        items[index] = replace(items[index], name=items[index].object.replace(" ", "_"))
    return items[index].name


def _metres(phrase: re.Match[str]) -> float | None:
    if phrase["number"] is None:
        return None
    number = phrase["number"].replace(",", ".")
    value = _NUMBERS[number] if number in _NUMBERS else float(number)
    return round(value * _UNITS[phrase["unit"]], 6)


def _plain(name: str) -> str:
    """Remove names that contain numbers (such as can_355_2 or table 2) from a text."""
    return re.sub(r"\b[a-z]\w*_\w*|\b[a-z]+ \d+$", "", name)


def _check_subject(subject: str, sentence: str) -> None:
    if re.match(r"(?:two|three|four|five|six|some|several|many|\d+)\b", subject):
        raise _refusal(sentence, f"'{subject}' means several objects; name them one by one")
    if re.search(r"\b(?:from|away|between|at|is|are|not|no|inside|in|against|above|over|that|which)\b", subject):
        raise _refusal(sentence, f"'{subject}' is not understood as the name of an object")


def _refusal(sentence: str, problem: str) -> LayoutError:
    return LayoutError(f"cannot read '{sentence}': {problem}; supported are {READS}. Use a layout file for more")
