"""Convert sentences to object layouts with a language model, if the fixed grammar of `grammar` cannot read the sentences.

The model gets the sentence, the names of the catalogue objects and the names of the scene's surfaces. The model answers in the JSON schema
of layouts. If an answer is not a layout or contains an unknown name, the model gets the reason for the refusal and answers again. The model
gives only names and relations; the module `place` computes the coordinates.
"""

from __future__ import annotations

import json
import warnings

import numpy as np

from radartwin.errors import BackendError, LayoutError
from radartwin.io import untrusted_json
from radartwin.io.chat import Endpoint
from radartwin.scene.layouts import grammar
from radartwin.scene.layouts.anchor import find
from radartwin.scene.layouts.layout import RELATIONS, SCHEMA, SENSOR_NAMES, Layout
from radartwin.scene.layouts.stock import names as stock_names
from radartwin.scene.scene import Scene

ANSWERS = 3  # largest number of answers that are requested from the model per sentence
_MAX_NAMES = 300  # number of surface names in the question to the model; larger surfaces have priority


def read_sentence(sentence: str, scene: Scene, sensor_pose: np.ndarray | None = None, endpoint: Endpoint | None = None) -> Layout:
    """Convert a sentence to an object layout with the fixed grammar, or else with the language model at `endpoint`.

    Raises:
        LayoutError: the fixed grammar cannot read the sentence and `endpoint` is None.
        BackendError: the server of the language model does not respond, or none of ANSWERS answers of the model is usable.
    """
    try:
        return grammar.parse(sentence)
    except LayoutError:
        if endpoint is None:
            raise
    messages = [{"role": "system", "content": _task(scene)}, {"role": "user", "content": sentence}]
    problem = ""
    for _ in range(ANSWERS):
        text = endpoint.complete(messages, SCHEMA, "layout")
        try:
            layout = Layout.from_dict(_parsed(text), "the answer")
            _check_names(layout, scene, sensor_pose)
            return layout
        except LayoutError as error:
            problem = str(error)
        messages += [
            {"role": "assistant", "content": text[:2000]},
            {"role": "user", "content": f"That cannot be used: {problem}. Answer again, with the JSON alone."},
        ]
    raise BackendError(
        f"{endpoint.model} at {endpoint.public_url} gave no usable layout in {ANSWERS} answers: {problem}; write a layout file instead"
    )


def _task(scene: Scene) -> str:
    largest = sorted((s for s in scene if s.name), key=lambda s: -float(s.mesh.area))
    if len(largest) > _MAX_NAMES:
        warnings.warn(
            f"the scene has {len(largest)} named surfaces, and the question to the model lists only the {_MAX_NAMES} largest ones; "
            "use a layout file to refer to a smaller surface",
            stacklevel=2,
        )
    return (
        "Turn the user's sentence into a layout: which objects go where in a room. Answer with JSON alone, in this schema:\n"
        f"{json.dumps(SCHEMA)}\n"
        f"object must be one of: {', '.join(stock_names())}.\n"
        f"on and anchor must be one of: {', '.join(dict.fromkeys(s.name for s in largest[:_MAX_NAMES]))}, {SENSOR_NAMES[0]}, "
        "or the name of an object placed earlier in the list.\n"
        f"relation is one of: {', '.join(RELATIONS)}. Distances are metres. Give positions only where the sentence gives coordinates. "
        "Leave out what the sentence does not say."
    )


def _parsed(text: str) -> object:
    """Extract the JSON object from the model's answer, because small models often put the object into a code block."""
    start, end = text.find("{"), text.rfind("}")
    try:
        return untrusted_json.load(text[start : end + 1])
    except ValueError as error:
        raise LayoutError(f"it is not JSON ({error})") from error


def _check_names(layout: Layout, scene: Scene, sensor_pose: np.ndarray | None) -> None:
    """Raise an error if the layout names an unknown object or an anchor that the scene does not contain."""
    placed: set[str] = set()
    for item in layout.items:
        if item.object not in stock_names():
            raise LayoutError(f"no object is called '{item.object}'; there are {', '.join(stock_names())}")
        for text in [*([item.on] if item.on else []), *(r.anchor for r in item.relations)]:
            if text not in placed:
                find(text, scene, sensor_pose)
        placed.add(item.name or item.object)
