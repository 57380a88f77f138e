"""Private parameters of a rospy node against a schema: all errors at once, nothing silently replaced by a default."""

import difflib


class ParameterError(Exception):
    """All that is wrong, one error per element."""

    def __init__(self, errors):
        super().__init__("; ".join(errors))
        self.errors = errors


def flatten(tree, prefix=""):
    """A parameter tree as a flat dict, keys joined by '/'; numbers become floats."""
    flat = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f"{prefix}{key}/"))
        elif isinstance(value, list):
            flat[prefix + key] = [_number(element) for element in value]
        else:
            flat[prefix + key] = _number(value)
    return flat


def _number(value):
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def read(schema, given):
    """The values of `schema` {key: (default, lowest, highest, meaning)}, replaced by what is given. An integer default
    wants an integer, a float a number, a bool a flag, a text a text. Raises ParameterError."""
    errors, values = [], {key: entry[0] for key, entry in schema.items()}
    for key, value in given.items():
        if key not in schema:
            meant = difflib.get_close_matches(key, schema, 1)
            hint = f'did you mean "{meant[0]}"?' if meant else f"known: {', '.join(schema)}"
            errors.append(f"{key}: unknown parameter; {hint}")
            continue
        default, low, high, meaning = schema[key]
        kind = type(default)
        fits = isinstance(value, kind) or (kind is float and isinstance(value, int))
        if not fits or (isinstance(value, bool) and kind is not bool):
            errors.append(f"{key} = {value!r}: expected {_KINDS[kind]} ({meaning})")
        elif low is not None and not low <= value <= high:
            errors.append(f"{key} = {value!r}: expected {low} to {high} ({meaning})")
        else:
            values[key] = kind(value)
    if errors:
        raise ParameterError(errors)
    return values


_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
