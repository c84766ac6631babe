"""Decode the messages of a topic: ROS 1 and ROS 2 by the types that the bag defines (rosbags), and JSON."""

import json
from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import TYPE_CHECKING

from cmr_tools.importing.ros_fields import Types
from cmr_tools.importing.ros_records import Topic, type_name

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

DecodeMessage = Callable[[bytes], object]

ROS_ENCODINGS = ("ros1", "cdr")
IDL_RULE = "=" * 80 + "\n"  # stands before each of several IDL files in one definition


class DecodeError(Exception):
    """A message is damaged."""


class TypeUnknownError(Exception):
    """The topic's messages cannot be decoded; the text says why, and what to do."""


@lru_cache(maxsize=64)  # rosbags compiles code for a type; split bags announce each topic again
def decoder(topic: Topic, definition: str | None) -> tuple[DecodeMessage, Types | None]:
    """Return a decoder for the topic's messages, and their types, which JSON does not have.

    `definition` is the text of their .msg file for a bag that holds none. The decoder raises DecodeError. Raises
    TypeUnknownError, and ModuleNotFoundError without rosbags.
    """
    if topic.encoding == "json":
        return _decode_json, None
    if topic.encoding not in ROS_ENCODINGS:
        raise TypeUnknownError(f"is encoded as {topic.encoding or 'nothing known'}; read are ros1, cdr and json")
    store = _store(topic, definition)
    name = _known_name(store, topic)
    decode = store.deserialize_ros1 if topic.encoding == "ros1" else store.deserialize_cdr

    def decode_ros(data: bytes) -> object:
        try:
            return decode(data, name)
        except Exception as error:  # generated code on arbitrary bytes: on any exception, this message is lost
            raise DecodeError(str(error)) from error

    return decode_ros, Types(name, store.fielddefs)


def _decode_json(data: bytes) -> object:
    try:
        return json.loads(data, object_hook=lambda content: SimpleNamespace(**content))
    except (ValueError, TypeError, RecursionError) as error:
        raise DecodeError(str(error)) from error


def _store(topic: Topic, definition: str | None) -> "Typestore":
    """Return a store of the topic's own types; for a bag that defines none, of the standard types of ROS."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if topic.definition and topic.language in ("msg", "idl"):
        store = get_typestore(Stores.EMPTY)
        _register(store, topic, topic.definition)
        return store
    store = get_typestore(Stores.ROS1_NOETIC if topic.encoding == "ros1" else Stores.LATEST)
    if definition is not None and topic.message_type not in store.fielddefs:
        try:
            store.register(get_types_from_msg(definition, topic.message_type))
        except Exception as error:  # of a parser, on arbitrary text
            raise TypeUnknownError(f"has a definition in the mapping that is none of a .msg file ({error})") from error
    return store


def _register(store: "Typestore", topic: Topic, definition: str) -> None:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    try:
        if topic.language == "msg":
            store.register(get_types_from_msg(definition, topic.message_type))
            return
        for part in definition.split(IDL_RULE):
            head, _, rest = part.partition("\n")
            text = rest if head.startswith("IDL: ") else part
            if text.strip():
                store.register(get_types_from_idl(text))
    except Exception as error:  # of a parser, on arbitrary text
        raise TypeUnknownError(
            f"has a definition of {topic.message_type} in the bag that is damaged ({' '.join(str(error).split())[:80]})"
        ) from error


def _known_name(store: "Typestore", topic: Topic) -> str:
    name = type_name(topic.message_type.replace("::", "/").removesuffix("_"))
    if name not in store.fielddefs:
        raise TypeUnknownError(
            f"is of type {topic.message_type or 'unknown'}, which neither the bag nor rosbags defines; "
            "give the text of its .msg file as `definition` of the topic in the mapping"
        )
    try:
        store.get_msgdef(name)
    except Exception as error:  # a damaged definition that names members of types which it does not define
        raise TypeUnknownError(f"is of type {name}, whose definition is not complete ({error!r})") from error
    return name
