"""A parameter that is wrong must stop a node, not quietly become the default, and all that is wrong is said at once."""

import math

import pytest
from node_parameters import ParameterError, flatten, read

SCHEMA = {"states": (40, 2, 1000, "of the model"), "horizon": (0.2, 0.02, 5.0, "[s]"),
          "record": (True, None, None, "bags"), "path": ("", None, None, "of the model")}


def errors_of(given):
    with pytest.raises(ParameterError) as caught:
        read(SCHEMA, given)
    return caught.value.errors


def test_what_is_not_given_keeps_its_default():
    assert read(SCHEMA, {"states": 7, "horizon": 1}) == {"states": 7, "horizon": 1.0, "record": True, "path": ""}


def test_all_errors_are_listed_at_once():
    errors = errors_of({"state": 3, "horizon": "0.5", "record": 1, "path": 2})
    assert len(errors) == 4
    assert errors[0] == 'state: unknown parameter; did you mean "states"?'
    assert errors[1] == "horizon = '0.5': expected a number ([s])"
    assert errors[2] == "record = 1: expected true or false (bags)"
    assert errors[3] == "path = 2: expected a text (of the model)"


@pytest.mark.parametrize("key, value", [("states", 1), ("states", 1001), ("states", 3.0), ("states", True),
                                        ("horizon", math.nan), ("horizon", math.inf), ("horizon", False)])
def test_out_of_range_and_wrong_kind(key, value):
    assert len(errors_of({key: value})) == 1


def test_a_tree_becomes_paths_and_numbers_become_floats():
    tree = {"override": {"robots": {"admittance": {"mass": [60, 60]}}}, "seed": 3, "flag": True, "controllers": ["lqr"]}
    flat = flatten(tree)
    assert flat == {"override/robots/admittance/mass": [60.0, 60.0], "seed": 3.0, "flag": True, "controllers": ["lqr"]}
    assert isinstance(flat["seed"], float) and isinstance(flat["flag"], bool)
