"""RadarTwin converts sentences about furniture to furniture layouts. A sentence that is not understood is refused, and the message quotes
the unknown part.
"""

import pytest

from radartwin.errors import LayoutError
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.layout import Layout

MUG = {"object": "mug"}


def at(relation, anchor, distance_m=None):
    return {"relation": relation, "anchor": anchor} | ({} if distance_m is None else {"distance_m": distance_m})


READ = {
    "a mug on the table 1.5 m in front of the door": [MUG | {"on": "table", "relations": [at("in front of", "door", 1.5)]}],
    "Put the mug 30 cm to the left of the radar.": [MUG | {"relations": [at("left of", "radar", 0.3)]}],
    "a mug half a metre behind the sofa": [MUG | {"relations": [at("behind", "sofa", 0.5)]}],
    "a mug one and a half metres in front of the sensor": [MUG | {"relations": [at("in front of", "sensor", 1.5)]}],
    "mug 1,2m in front of the left table": [MUG | {"relations": [at("in front of", "left table", 1.2)]}],
    "a mug next to the shelf, and a can under the table": [
        MUG | {"relations": [at("beside", "shelf")]},
        {"object": "can", "relations": [at("under", "table")]},
    ],
    "a mug on the table and 1 m in front of the door": [MUG | {"on": "table", "relations": [at("in front of", "door", 1.0)]}],
    "a box on the floor. a can on it and a mug beside it": [
        {"object": "box", "name": "box", "on": "floor"},
        {"object": "can", "name": "can", "on": "box"},
        MUG | {"relations": [at("beside", "can")]},
    ],
    "the can_355 on table 2 turned by 45 degrees": [{"object": "can_355", "on": "table 2", "yaw_deg": 45.0}],
    "a can_211_300 on the desk": [{"object": "can_211_300", "on": "desk"}],
    "a corner reflector 2 m in front of the radar 500 mm right of the cabinet": [
        {"object": "corner reflector", "relations": [at("in front of", "radar", 2.0), at("right of", "cabinet", 0.5)]}
    ],
}


@pytest.mark.parametrize(("sentence", "layout"), READ.items(), ids=READ)
def test_a_simple_sentence_is_read(sentence, layout):
    assert parse(sentence) == Layout.from_dict({"objects": layout})


NOT_READ = {
    "": "empty",
    "a mug": "gives no place",
    "on the table": "names no object",
    "two mugs on the table": "several",
    "a mug 1.5 in front of the door": "no unit",
    "a mug between the door and the window": "not",
    "a mug 2 m away from the door": "gives no place",
    "a mug on the table with a lid": "'table with a lid'",
    "a mug on the table on the floor": "two things",
    "a mug 1 m on the table": "'on' takes none",
    "a mug on": "not followed by a name",
    "a mug on it": "refers to no object",
    "is there a mug on the table": "not understood",
}


@pytest.mark.parametrize(("sentence", "word"), NOT_READ.items(), ids=NOT_READ)
def test_an_unknown_phrase_is_refused_with_the_supported_phrases(sentence, word):
    with pytest.raises(LayoutError, match=word) as caught:
        parse(sentence)
    assert "supported are 'OBJECT on THING'" in str(caught.value)
