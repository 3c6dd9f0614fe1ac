"""Hypothesis strategies that change a valid file: its bytes, the words and lines of a text, or the values of a JSON tree."""

from __future__ import annotations

import io
import json
import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any

from hypothesis import strategies as st
from made_files import glb

STRANGE = (
    "nan", "-inf", "1e999", "-1", "0", "1.5", "9" * 40, "true", "null", "x", "", "../x", "/", "'", '"', "\\", "é", "\x00", "- a: [", "{",
)  # fmt: skip
_WORD = re.compile(r"[^\s,:=\[\]{}]+")

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


def variants(content: bytes, how: str) -> st.SearchStrategy[bytes]:
    """Return a strategy of changed versions of a file. `how` is json, lines (one JSON tree per line), glb (the JSON tree inside a binary
    glTF file), words or bytes.
    """
    if how == "json":
        return with_changes(json.loads(content)).map(lambda tree: json.dumps(tree).encode())
    if how == "words":
        return replaced(content.decode()).map(str.encode)
    if how == "lines":
        lines = content.decode().splitlines()
        return with_changes(json.loads(lines[0])).map(lambda tree: (json.dumps(tree) + "\n" + "\n".join(lines[1:]) + "\n").encode())
    if how == "glb":
        length = struct.unpack("<I", content[12:16])[0]
        stream = io.BytesIO(content[20 + length :])
        binary = stream.read(struct.unpack("<II", stream.read(8))[0])
        return with_changes(json.loads(content[20 : 20 + length])).map(lambda tree: glb(tree, binary))
    return changed(content)


def changed(seed: bytes) -> st.SearchStrategy[bytes]:
    """Return a strategy of the file with bytes replaced, of the file with a part cut out, and of arbitrary bytes."""

    def apply(edits: list[tuple[int, int, bytes]]) -> bytes:
        content = seed
        for start, length, new in edits:
            at = start % (len(content) + 1)
            content = content[:at] + new + content[at + length % 40 :]
        return content

    new = st.binary(max_size=8) | st.sampled_from([b"nan", b"1e999", b"-1", b"0", b"\n"])
    edit = st.tuples(st.integers(0, 1 << 16), st.integers(0, 39), new)
    return st.lists(edit, min_size=1, max_size=4).map(apply) | st.binary(max_size=200)


def with_changes(tree: Any) -> st.SearchStrategy[Any]:
    """Return a strategy of the JSON tree with one leaf or branch replaced by an arbitrary value."""

    def put(place: tuple, value: Any) -> Any:
        copy = json.loads(json.dumps(tree))
        node = copy
        for step in place[:-1]:
            node = node[step]
        node[place[-1]] = value
        return copy

    return st.builds(put, st.sampled_from(list(_places(tree))), values)


def _places(tree: Any, path: tuple = ()) -> Iterator[tuple]:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from _places(value, (*path, key))


def replaced(seed: str) -> st.SearchStrategy[str]:
    """Return a strategy of the text with one to three words replaced, or with a line removed or repeated."""
    words, lines = list(_WORD.finditer(seed)), seed.splitlines(keepends=True)

    def put(edits: Sequence[tuple[int, str]]) -> str:
        text = seed
        for at, new in sorted(edits, reverse=True):  # edit from the end, so that the positions of the other edits stay valid
            text = text[: words[at].start()] + new + text[words[at].end() :]
        return text

    places = st.integers(0, len(words) - 1)
    edits = st.lists(st.tuples(places, st.sampled_from(STRANGE)), min_size=1, max_size=3, unique_by=lambda edit: edit[0]).map(put)
    line = st.integers(0, len(lines) - 1)
    lost = line.map(lambda k: "".join(lines[:k] + lines[k + 1 :]))
    repeated = st.tuples(line, line).map(lambda pair: "".join([*lines[: pair[0]], lines[pair[1]], *lines[pair[0] :]]))
    return edits | lost | repeated
