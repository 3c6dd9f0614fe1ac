"""Encode the messages of radartwin.recordings.foxglove in Protobuf, for viewers that do not read JSON.

The numbers and types of the fields are those of Foxglove's published definitions (github foxglove/foxglove-sdk, schemas/proto/foxglove). A
schema is a FileDescriptorSet with the definitions of the messages, as MCAP prescribes for the encoding "protobuf" (mcap.dev/spec/registry).
"""

from __future__ import annotations

import base64
from functools import cache
from typing import Any

from radartwin.errors import BackendError
from radartwin.recordings.foxglove import FIELDS, NUMERIC_TYPES

_SCALARS = {"double": 1, "fixed32": 7, "string": 9, "bytes": 12}  # of FieldDescriptorProto.Type
_MESSAGE, _ENUM = 11, 14
_OPTIONAL, _REPEATED = 1, 3  # of FieldDescriptorProto.Label


def schema(name: str) -> bytes:
    """Return the serialised FileDescriptorSet that defines all messages of a timeline, among them the message `name`."""
    return _definitions()[0]


def encode(name: str, message: dict[str, Any]) -> bytes:
    """Encode a message of radartwin.recordings.foxglove as the Protobuf message `name`."""
    return _filled(_definitions()[1][name](), message).SerializeToString(deterministic=True)


def check() -> None:
    """Raise BackendError if the package protobuf is missing."""
    try:
        import google.protobuf  # noqa: F401
    except ImportError as error:
        raise BackendError("--encoding protobuf needs the package protobuf; install it with pip install 'radartwin[mcap]'") from error


@cache
def _definitions() -> tuple[bytes, dict[str, Any]]:
    """Return the serialised FileDescriptorSet and the class of each message by its name."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    for package in ("foxglove", "radartwin"):
        file = files.file.add(name=f"{package}/timeline.proto", package=package, syntax="proto3")
        file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
        for title, fields in FIELDS.items():
            if title.partition(".")[0] != package:
                continue
            message = file.message_type.add(name=title.partition(".")[2])
            for number, (name, kind) in enumerate(fields, start=1):
                label, kind = (_REPEATED, kind.split()[1]) if kind.startswith("repeated ") else (_OPTIONAL, kind)
                field: Any = message.field.add(name=name, number=number, label=label)
                field.type = _SCALARS.get(kind) or (_ENUM if kind.endswith("NumericType") else _MESSAGE)
                if kind not in _SCALARS:
                    field.type_name = ".google.protobuf.Timestamp" if kind == "Timestamp" else f".{kind}"
            if title == "foxglove.PackedElementField":
                enum = message.enum_type.add(name="NumericType")
                for number, name in enumerate(NUMERIC_TYPES):
                    enum.value.add(name=name, number=number)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    classes = {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in FIELDS}
    return files.SerializeToString(deterministic=True), classes


def _filled(target: Any, message: dict[str, Any]) -> Any:
    """Set the fields of the Protobuf message `target` to the values of a JSON message, and return `target`."""
    for name, value in message.items():
        if name == "timestamp":
            target.timestamp.seconds, target.timestamp.nanos = value["sec"], value["nsec"]
        elif isinstance(value, dict):
            _filled(getattr(target, name), value).SetInParent()
        elif isinstance(value, list):
            for item in value:
                _filled(getattr(target, name).add(), item) if isinstance(item, dict) else getattr(target, name).append(item)
        else:
            setattr(target, name, base64.b64decode(value) if name == "data" else value)
    return target
