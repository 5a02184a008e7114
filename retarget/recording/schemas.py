"""The messages of a recording as ROS 2 defines them (`ros2msg`): standard ones wherever there is one."""

__all__ = ["SCHEMAS"]

_LINE = "=" * 80
_TIME = "builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"
_HEADER = "std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"
_POINT = "geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"
_VECTOR = "geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"
_TURN = "geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE = "geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
_TRANSFORM = (
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
)
_STAMPED = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
)


def _definition(own: str, *others: tuple[str, str]) -> str:
    """A definition followed by those that it is made of, as `ros2msg` has them."""
    return own + "".join(f"{_LINE}\nMSG: {name}\n{text}" for name, text in others)


SCHEMAS: dict[str, str] = {
    "geometry_msgs/msg/PoseArray": _definition(
        "std_msgs/Header header\ngeometry_msgs/Pose[] poses\n", _HEADER, _TIME, _POSE, _POINT, _TURN
    ),
    "sensor_msgs/msg/JointState": _definition(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        _HEADER,
        _TIME,
    ),
    "tf2_msgs/msg/TFMessage": _definition(
        "geometry_msgs/TransformStamped[] transforms\n", _STAMPED, _HEADER, _TIME, _TRANSFORM, _VECTOR, _TURN
    ),
    "rcl_interfaces/msg/Log": _definition(
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\n"
        "uint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
        _TIME,
    ),
    "retarget_msgs/msg/Servos": _definition(
        "std_msgs/Header header\nstring[] name\nfloat64 bus_time\nuint8 answer\nint32 retries\nfloat64 rough\n"
        "int32[] position\nfloat64[] velocity\nfloat64[] current\nfloat64[] voltage\nfloat64[] temperature\n"
        "float64[] age\nuint8[] error\nuint8[] alert\nbool[] valid\nbool[] driven\n",
        _HEADER,
        _TIME,
    ),
    "retarget_msgs/msg/Posture": _definition("std_msgs/Header header\nfloat32[] q\n", _HEADER, _TIME),
    "retarget_msgs/msg/Tick": _definition(
        "std_msgs/Header header\nuint32 cycle\nint32 tick\nuint32 asked\nint8 phase\nuint8 state\nuint8 sampled\n"
        "uint8 written\nbool kept\nbool gated\nbool unled\nuint8 readings\nfloat64 settled\nfloat64[] clock\n"
        "int32[] goal\nfloat32[] root\nfloat64[] sensor_weight\nbool weighted\nbool[] sensor_valid\n"
        "bool[] sensor_oriented\nuint8[] observer_modes\nuint8[] human_observer_modes\nfloat32[] cost\n",
        _HEADER,
        _TIME,
    ),
}
"""By full name; docs/recording.md tells their fields."""
