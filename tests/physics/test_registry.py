"""Fields and flows by name: with parameters, from a user's own package, and as plain data again."""

import json
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from swarm.physics.fields import FIELDS, FunctionField, LinearField
from swarm.physics.flows import FLOWS, FunctionFlow, PoiseuilleFlow, Vortex
from swarm.physics.world import World

RIDGE = """
class Ridge:
    def __init__(self, gradient_scale=1.0):
        self.gradient_scale = gradient_scale

    def concentration(self, position):
        return 50.0 - self.gradient_scale * abs(position[..., 0])
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs the module `mine`, and a package with entry points of fields."""

    def installed(module, package="mine", **points):
        (tmp_path / "mine.py").write_text(module)
        folder = tmp_path / f"{package}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        lines = [f"{name} = {value}" for name, value in points.items()]
        (folder / "entry_points.txt").write_text("\n".join(["[chemoswarm.fields]", *lines]))
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "mine", raising=False)

    yield installed
    sys.modules.pop("mine", None)


def test_a_world_takes_a_name_a_mapping_or_an_object():
    assert World(flow="vortex") == World(flow={"type": "vortex"}) == World(flow=Vortex())
    made = World(field={"type": "linear", "offset": 3}, flow={"type": "poiseuille", "walls": [1, 4]})
    assert made == World(field=LinearField(offset=3.0), flow=PoiseuilleFlow(walls=(1.0, 4.0)))


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("liner", "field must be one of diffusing_source, .*, got 'liner'; did you mean 'linear'"),
        ({"type": "liner"}, "field must be one of .*, got 'liner'; did you mean 'linear'"),
        ({"type": 3}, "field must be one of .*, got 3"),
        ({"offset": 3}, "field must state its type, one of diffusing_source, .*, got {'offset': 3}"),
        (
            {"type": "linear", "ofset": 3},
            "parameter of field 'linear' must be one of .*, got 'ofset'; did you mean 'offset'",
        ),
        ({"type": "linear", "offset": "high"}, "field 'linear': offset must be a finite number, got 'high'"),
        ({"type": "gridded"}, "field 'gridded' must have path, edges, got {}"),
        (
            {"type": "gridded", "path": "my.nc", "edges": "clamped"},
            "field 'gridded': data must be a file that exists, got my.nc",
        ),
        ({"type": "gridded", "data": "my.nc", "edges": "clamped"}, "parameter of field 'gridded' .* 'data'"),
    ],
)
def test_an_error_names_the_thing_the_rule_the_value_and_the_nearest_name(field, message):
    with pytest.raises((TypeError, ValueError, OSError), match=f"^{message}"):
        World(field=field)


PARTS = [(FIELDS, name) for name in FIELDS] + [(FLOWS, name) for name in FLOWS]


@pytest.mark.parametrize(
    ("registry", "name"), [part for part in PARTS if part[1] != "gridded"], ids=lambda value: str(value)[:20]
)
def test_what_describes_a_part_makes_it_again(registry, name):
    part = registry[name]()
    described = registry.describe(part)
    assert described["type"] == name
    assert registry.make(json.loads(json.dumps(described))) == part


def test_what_is_no_plain_data_is_not_described():
    assert FIELDS.describe(FunctionField(np.sin, 1.0)) is None
    assert FLOWS.describe(FunctionFlow(np.sin, 1.0, 1.0)) is None
    assert FLOWS.describe(LinearField()) is None


def test_a_class_registers_where_it_is_defined():
    @FIELDS.register("hill")
    @dataclass(frozen=True)
    class Hill(LinearField):
        slope: float = 1.0

    world = World(field={"type": "hill", "slope": 2.0})
    assert isinstance(world.field, Hill)
    assert FIELDS.describe(world.field) == {
        "type": "hill",
        "gradient_scale": 1.0,
        "offset": 20.0,
        "slope": 2.0,
    }
    with pytest.raises(ValueError, match=r"field 'linear' must be one class, got .*LinearField.*Hill"):
        FIELDS.register("linear")(Hill)


def test_a_name_from_a_package_is_imported_when_it_is_asked_for(install):
    install(RIDGE, ridge="mine:Ridge")
    assert "ridge" in list(FIELDS)
    with pytest.raises(ValueError, match=r"must be one of .*, ridge, .*got 'rigde'; did you mean 'ridge'"):
        World(field="rigde")
    assert "mine" not in sys.modules
    world = World(field={"type": "ridge", "gradient_scale": 2.0})
    assert world.field.concentration(np.array([[3.0, 1.0]])) == [44.0]
    assert FIELDS.describe(world.field) == {"type": "ridge", "gradient_scale": 2.0}


@pytest.mark.parametrize(
    ("point", "reason"),
    [
        ("mine:Ridge", "must be importable from mine:Ridge, got ModuleNotFoundError: No module named 'gone'"),
        ("mine:Other", "must be importable from mine:Other, got"),
        ("math:pi", "must be a class, got 3.14.* from math:pi"),
    ],
)
def test_a_package_that_is_broken_is_named_in_one_line(install, point, reason):
    install("import gone", ridge=point)
    World(field="linear")
    with pytest.raises(ValueError, match=f"^field 'ridge' {reason}.*$") as error:
        World(field="ridge")
    assert "\n" not in str(error.value)


def test_a_name_that_two_packages_claim_is_an_error(install):
    install(RIDGE, ridge="mine:Ridge")
    install(RIDGE, "other", ridge="mine:Other")
    with pytest.raises(ValueError, match=r"field 'ridge' must come from one package, got mine:.*, mine:"):
        World(field="ridge")
