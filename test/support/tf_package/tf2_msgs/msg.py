"""A real message type tf2_msgs/msg/TFMessage, which Fast DDS sends and receives.

The wheels have geometry_msgs/TransformStamped in C. A TFMessage is a sequence of these: its length
is written as std_msgs/UInt32 writes a number, then each of them as its own type support does. The
structures are those of rosidl_runtime_c and of rosidl_typesupport_fastrtps_cpp.
"""

from __future__ import annotations

import ctypes
from ctypes import CDLL, CFUNCTYPE, PYFUNCTYPE, Structure, byref, c_char_p, c_size_t, c_void_p

from geometry_msgs.msg import TransformStamped

_FORM = b"rosidl_typesupport_fastrtps_c"
_DESCRIBED = b"rosidl_typesupport_introspection_c"
_ELEMENT = "geometry_msgs__msg__TransformStamped"
_ITEM_BYTES = 8 + 24 + 24 + 56  # stamp, two strings, seven doubles


class _Sequence(Structure):
    _fields_ = (("data", c_void_p), ("size", c_size_t), ("capacity", c_size_t))

    def items(self):
        return [self.data + k * _ITEM_BYTES for k in range(self.size)]


class _Callbacks(Structure):
    _fields_ = (
        *(("namespace", c_char_p), ("name", c_char_p)),
        *((name, c_void_p) for name in ("write", "read", "size", "most", "keys")),
    )


class _Support(Structure):
    _fields_ = (
        ("form", c_char_p),
        *((name, c_void_p) for name in ("data", "find", "hash", "description", "sources")),
    )


def _symbol(library, name, result, *arguments):
    function = getattr(library, name)
    function.restype, function.argtypes = result, arguments
    return function


_made = CDLL("libgeometry_msgs__rosidl_generator_c.so")
_sent = CDLL("libgeometry_msgs__rosidl_typesupport_fastrtps_c.so")
_number = CDLL("libstd_msgs__rosidl_typesupport_fastrtps_c.so")
_python = ctypes.PyDLL("libgeometry_msgs__rosidl_generator_py.so")
_Pointer, _Bool = c_void_p, ctypes.c_bool
# DDS describes the type to others by its members. Those of an element do: both sides are ours.
_described = _symbol(
    CDLL("libgeometry_msgs__rosidl_typesupport_introspection_c.so"),
    f"rosidl_typesupport_introspection_c__get_message_type_support_handle__{_ELEMENT}",
    _Pointer,
)
_init = _symbol(_made, f"{_ELEMENT}__Sequence__init", _Bool, _Pointer, c_size_t)
_fini = _symbol(_made, f"{_ELEMENT}__Sequence__fini", None, _Pointer)
_write_item = _symbol(_sent, f"cdr_serialize_{_ELEMENT}", _Bool, _Pointer, _Pointer)
_read_item = _symbol(_sent, f"cdr_deserialize_{_ELEMENT}", _Bool, _Pointer, _Pointer)
_item_size = _symbol(_sent, f"get_serialized_size_{_ELEMENT}", c_size_t, _Pointer, c_size_t)
_write_number = _symbol(_number, "cdr_serialize_std_msgs__msg__UInt32", _Bool, _Pointer, _Pointer)
_read_number = _symbol(_number, "cdr_deserialize_std_msgs__msg__UInt32", _Bool, _Pointer, _Pointer)
_from_python = _symbol(
    _python,
    "geometry_msgs__msg__transform_stamped__convert_from_py",
    *(_Bool, ctypes.py_object, _Pointer),
)
_to_python = _symbol(
    _python, "geometry_msgs__msg__transform_stamped__convert_to_py", ctypes.py_object, _Pointer
)
_alive = {}  # sequences by address, and what C points to


@CFUNCTYPE(_Bool, _Pointer, _Pointer)
def _write(message, cdr):
    found = _Sequence.from_address(message)
    number = ctypes.c_uint32(found.size)
    items = found.items()
    return _write_number(byref(number), cdr) and all(_write_item(item, cdr) for item in items)


@CFUNCTYPE(_Bool, _Pointer, _Pointer)
def _read(cdr, message):
    number = ctypes.c_uint32()
    if not _read_number(cdr, byref(number)):
        return False
    _fini(message)
    _init(message, number.value)
    return all(_read_item(cdr, item) for item in _Sequence.from_address(message).items())


@CFUNCTYPE(ctypes.c_uint32, _Pointer)
def _size(message):
    items = _Sequence.from_address(message).items()
    return 4 + sum(_item_size(item, 0) + 8 for item in items)  # 8: any alignment


@CFUNCTYPE(c_size_t, _Pointer)
def _most(bounds):
    ctypes.c_char.from_address(bounds).value = b"\0"  # unbounded
    return 4


@CFUNCTYPE(_Pointer, _Pointer, c_char_p)
def _find(support, form):
    if form == _FORM:
        return support
    return _described() if form == _DESCRIBED else None


@PYFUNCTYPE(_Pointer)
def _create():
    made = _Sequence()
    _init(byref(made), 0)
    _alive[ctypes.addressof(made)] = made
    return ctypes.addressof(made)


@PYFUNCTYPE(None, _Pointer)
def _destroy(message):
    _fini(message)
    del _alive[message]


@PYFUNCTYPE(_Bool, ctypes.py_object, _Pointer)
def _convert_from(message, to):
    _fini(to)
    _init(to, len(message.transforms))
    items = _Sequence.from_address(to).items()
    return all(map(_from_python, message.transforms, items))


@PYFUNCTYPE(ctypes.py_object, _Pointer)
def _convert_to(message):
    return TFMessage([_to_python(item) for item in _Sequence.from_address(message).items()])


def _address(function):
    return ctypes.cast(function, c_void_p).value


def _capsule(pointer, name=b"tf2_msgs"):
    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, (c_void_p, c_char_p, c_void_p)
    _alive[name] = name
    return new(pointer, name, None)


def _type_support():
    functions = map(_address, (_write, _read, _size, _most))
    callbacks = _Callbacks(b"tf2_msgs::msg", b"TFMessage", *functions, None)
    # The hash is that of another type: no one compares it.
    told = [
        _address(getattr(_made, f"{_ELEMENT}__get_type_{what}"))
        for what in ("hash", "description", "description_sources")
    ]
    support = _Support(_FORM, ctypes.addressof(callbacks), _address(_find), *told)
    _alive["support"] = support, callbacks
    return _capsule(ctypes.addressof(support))


type(TransformStamped).__import_type_support__()  # C imports what it converts


class _Type(type):
    _CREATE_ROS_MESSAGE = _capsule(_address(_create))
    _CONVERT_FROM_PY = _capsule(_address(_convert_from))
    _CONVERT_TO_PY = _capsule(_address(_convert_to))
    _DESTROY_ROS_MESSAGE = _capsule(_address(_destroy))
    _TYPE_SUPPORT = _type_support()


class TFMessage(metaclass=_Type):
    """The message; ``transforms`` is a list of TransformStamped."""

    def __init__(self, transforms=()) -> None:
        self.transforms = list(transforms)

    @classmethod
    def get_fields_and_field_types(cls):
        """As each message class has it."""
        return {"transforms": "sequence<geometry_msgs/TransformStamped>"}
