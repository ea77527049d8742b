"""The quick decorator `dataclass` behaves like that of the standard library, and shares its methods."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable
from functools import cached_property
from typing import Any

import pytest

from rigs.quick_dataclass import dataclass, field, replace


@dataclass(frozen=True)
class _Point:
    x: float
    y: float = 2.0
    names: tuple[str, ...] = field(default_factory=tuple, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "y", abs(self.y))

    @cached_property
    def total(self) -> float:
        return self.x + self.y


@dataclass
class _Open:
    x: list[int] = field(default_factory=list)


def _defined_by(decorate: Callable[..., Any]) -> tuple[Any, Any]:
    def body() -> dict[str, Any]:
        return {"__annotations__": {"a": int, "b": str}, "b": "b"}

    return decorate(frozen=True)(type("Pair", (), body())), decorate(type("Pair", (), body()))


def test_objects_compare_hash_and_show_themselves_as_those_of_the_standard_library() -> None:
    texts, comparisons = [], []
    for decorate in (dataclass, dataclasses.dataclass):
        frozen, plain = _defined_by(decorate)
        texts.append([repr(frozen(1)), repr(plain(1, "c")), str(hash(frozen(1, "c")) == hash(frozen(1, "c")))])
        comparisons.append(
            [frozen(1) == frozen(1), frozen(1) == frozen(2), frozen(1) == plain(1), plain(1) == plain(1)]
        )
        with pytest.raises(TypeError, match="unhashable"):
            hash(plain(1))
    assert texts[0] == texts[1]
    assert comparisons[0] == comparisons[1] == [True, False, False, True]


def test_fields_that_are_not_compared_neither_differ_nor_show() -> None:
    assert _Point(1.0, names=("a",)) == _Point(1.0)
    assert hash(_Point(1.0, names=("a",))) == hash(_Point(1.0))
    assert repr(_Point(1.0, -3.0)) == "_Point(x=1.0, y=3.0)"


@pytest.mark.parametrize("name", ["x", "y", "names", "other"])
def test_a_frozen_object_refuses_every_change(name: str) -> None:
    point = _Point(1.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match=name):
        setattr(point, name, 5.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match=name):
        delattr(point, name)
    assert point == _Point(1.0)


def test_an_open_object_has_values_of_its_own_and_changes() -> None:
    first, second = _Open(), _Open()
    first.x.append(1)
    assert second.x == []
    second.x = [1]
    assert first == second


def test_objects_are_copied_pickled_and_may_cache_a_property() -> None:
    point = replace(_Point(1.0), x=4.0)
    assert (point, point.total) == (_Point(4.0), 6.0)
    assert pickle.loads(pickle.dumps(point)) == point  # noqa: S301 - its own bytes
    assert dataclasses.asdict(point) == {"x": 4.0, "y": 2.0, "names": ()}


@pytest.mark.parametrize("decorate", [dataclass, dataclasses.dataclass])
def test_derived_classes_add_fields_and_keep_the_rules(decorate: Callable[..., Any]) -> None:
    class Derived(_Point):
        pass

    Derived.__annotations__ = {"z": float}
    Derived.z = 3.0  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="non-frozen"):
        decorate(type("Loose", (_Point,), {"__annotations__": {}}))
    derived = decorate(frozen=True)(Derived)(1.0, z=5.0)
    assert (derived.x, derived.y, derived.z) == (1.0, 2.0, 5.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        derived.z = 0.0


def test_a_class_compiles_nothing_but_its_constructor() -> None:
    shared = ("__eq__", "__hash__", "__repr__", "__setattr__", "__delattr__")
    frozen, _ = _defined_by(dataclass)
    assert all(vars(frozen)[name] is vars(_Point)[name] for name in shared)


def test_a_method_of_the_class_itself_stays() -> None:
    @dataclass(frozen=True)
    class Named:
        name: str

        def __repr__(self) -> str:
            return self.name

        def __hash__(self) -> int:
            return 7

    assert (repr(Named("a")), hash(Named("a"))) == ("a", 7)


def test_an_object_that_contains_itself_is_shown() -> None:
    @dataclass
    class Node:
        others: list[Any]

    node = Node([])
    node.others.append(node)
    assert repr(node).endswith("Node(others=[...])")
