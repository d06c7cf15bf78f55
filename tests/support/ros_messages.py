"""Messages of an MCAP file by rosbags, which has its own reader and CDR decoder."""

from pathlib import Path
from typing import Any

from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def ros_messages(file: Path, topic: str) -> list[Any]:
    """Of the first topic that ends so."""
    store, reader = get_typestore(Stores.EMPTY), McapReader(file)
    reader.open()
    try:
        channel = next(c for c in reader.connections if c.topic.endswith(topic))
        types = get_types_from_msg(channel.msgdef.data, channel.msgtype)
        store.register({k: v for k, v in types.items() if k not in store.fielddefs})
        return [
            store.deserialize_cdr(data, channel.msgtype)
            for _, _, data in reader.messages(connections=[channel])
        ]
    finally:
        reader.close()
