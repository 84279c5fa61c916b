"""Message types that are known even if a bag does not define them."""

from enum import StrEnum
from typing import Any

from estimation.frames.flat import FRAME_FIELDS, LAYOUT_FIELDS, PLAIN_FIELDS


class MessageType(StrEnum):
    """Types of the messages that are read or written, in ROS 2's notation.

    - `FRAME`: this project's message, which holds a complete frame.
    - `ANSWER`: this project's message, which holds the answer to a frame.
    - `TAC3D`: message of the Tac3D ROS nodes; ports of these nodes may use another package.
    - `TAC3D_PAIR`: message of the Tac3D node for two fingers.
    - `POINTS`, `WRENCH`, `PICTURE`: messages of ROS.
    """

    FRAME = "contactmodel_msgs/msg/Frame"
    ANSWER = "contactmodel_msgs/msg/Answer"
    TAC3D = "tactile_msgs/msg/Frame"
    TAC3D_PAIR = "tactile_msgs/msg/TactileMsg"
    POINTS = "sensor_msgs/msg/PointCloud2"
    WRENCH = "geometry_msgs/msg/WrenchStamped"
    PICTURE = "sensor_msgs/msg/CompressedImage"


def _define_frame() -> str:
    """The fields of a flat frame, its dimensions, unit and convention, and its layout's fields."""
    kinds = {"U": "string", "f8": "float64", "i8": "int64", "i4": "int32", "i1": "int8"}
    kinds["u1"] = "uint8"
    fields = [
        f"{kinds[kind]}{'' if name in PLAIN_FIELDS else '[]'} {name}"
        for name, kind in FRAME_FIELDS.items()
    ]
    fields += ["uint8 dimensions", "string unit", "string convention"]
    fields += [f"{kinds[kind]}[] {name}" for name, kind in LAYOUT_FIELDS.items()]
    return "\n".join([*fields, ""])


MESSAGE_DEFINITIONS = {
    MessageType.FRAME: _define_frame(),
    MessageType.TAC3D: """\
string SN
uint32 index
float64 sendTimestamp
float64 recvTimestamp
float64[1200] Positions
float64[1200] Displacements
float64[1200] Forces
float64[3] ResultantForce
float64[3] ResultantMoment
""",
    MessageType.TAC3D_PAIR: """\
std_msgs/Header header
Frame left
Frame right
""",
}
"""Definitions of the types, in the format of `.msg` files."""


def ros_types(name: str = "", definition: str = "", *, idl: bool = False) -> Any:
    """Make a store of types for `rosbags`.

    Without a name, it has the types of ROS 2 and of `MESSAGE_DEFINITIONS`; else the types of a
    definition, which may be in IDL.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if name:
        store = get_typestore(Stores.EMPTY)
        types = get_types_from_idl(definition) if idl else get_types_from_msg(definition, name)
        store.register(types)
        return store
    store = get_typestore(Stores.LATEST)
    for own, text in MESSAGE_DEFINITIONS.items():
        add_type(store, own, text)
    return store


def add_type(store: Any, name: str, definition: str) -> None:
    """Add a type to a store of `ros_types`."""
    from rosbags.typesys import get_types_from_msg

    store.register(get_types_from_msg(definition, name))


def to_ros2_name(name: str) -> str:
    """Convert a type's name to ROS 2's notation: `sensor_msgs/Image` to `sensor_msgs/msg/Image`."""
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"
