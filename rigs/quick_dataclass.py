"""The decorator `dataclass` of the standard library, in a third of its time per class.

The standard library compiles up to seven methods per class from text. A command defines 150 classes before it starts,
which took a tenth of a small `rig analyse`. Here only `__init__` is compiled, and all classes share the other methods.
Creating, comparing or hashing an object takes about a microsecond longer, so classes of single samples do not use it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import FrozenInstanceError, asdict, field, fields, replace
from reprlib import recursive_repr
from typing import TYPE_CHECKING

__all__ = ("asdict", "dataclass", "field", "fields", "replace")

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, **options):
        """Decorate a class. Derived classes and those with other options are left to `dataclasses.dataclass`."""
        if cls is None:
            return lambda cls: dataclass(cls, frozen=frozen, **options)
        if options or dataclasses.is_dataclass(cls):
            return dataclasses.dataclass(cls, frozen=frozen, **options)
        shared = vars(_Plain) | (vars(_Frozen) if frozen else {})
        for name in (_SHARED & shared.keys()) - vars(cls).keys():
            setattr(cls, name, shared[name])
        cls = dataclasses.dataclass(cls, repr=False, eq=False)
        cls.__dataclass_params__.frozen = frozen  # for the rules about derived classes
        return cls

    _SHARED = {"__eq__", "__hash__", "__repr__", "__setattr__", "__delattr__"}

    def values_of(part):
        """Return the values of the fields that are compared."""
        return tuple(getattr(part, each.name) for each in fields(part) if each.compare)

    class _Plain:
        __hash__ = None

        def __eq__(self, peer):
            return values_of(self) == values_of(peer) if peer.__class__ is self.__class__ else NotImplemented

        @recursive_repr()
        def __repr__(self):
            shown = (f"{each.name}={getattr(self, each.name)!r}" for each in fields(self) if each.repr)
            return f"{type(self).__qualname__}({', '.join(shown)})"

    class _Frozen:
        def __hash__(self):
            return hash(values_of(self))

        def __setattr__(self, name, value):
            if name in vars(self) or name not in self.__dataclass_fields__:
                raise FrozenInstanceError(f"cannot assign to field {name!r}")
            vars(self)[name] = value  # by `__init__`

        def __delattr__(self, name):
            raise FrozenInstanceError(f"cannot delete field {name!r}")
