"""How annotations are executed in tests, and where that would cost more than it finds.

jaxtyping holds all axes of one name in a call to one length.  A call pays for that with a context
of its own, and a definition with two checks that are compiled.

- A function whose annotations name no axes is checked by beartype alone.
- A function within another is made anew with every call of that one, and is not checked.
"""

import typing
from types import FunctionType

import jaxtyping

_checked_with_axes = jaxtyping.jaxtyped


def execute_annotations() -> None:
    """Check the arguments and results of all that jaxrender defines from now on."""
    # The hook looks this name up where a function is defined.
    jaxtyping.jaxtyped = _jaxtyped
    jaxtyping.install_import_hook("jaxrender", "beartype.beartype")


def _jaxtyped(*decorated, **options):
    if decorated or options.get("typechecker") is None:
        return _checked_with_axes(*decorated, **options)
    return lambda definition: _checked(definition, options["typechecker"])


def _checked(definition, typechecker):
    if isinstance(definition, FunctionType):
        if "<locals>" in definition.__qualname__:
            return definition
        if not any(map(_names_axes, _hints_of(definition))):
            return typechecker(definition)
    return _checked_with_axes(definition, typechecker=typechecker)


def _hints_of(function: FunctionType) -> list:
    """Read annotations, which may be text; what cannot be read yet stays text."""
    try:
        return list(typing.get_type_hints(function).values())
    except (NameError, AttributeError, TypeError):
        return list(function.__annotations__.values())


def _names_axes(hint) -> bool:
    """Whether a hint holds an array with named axes; text may."""
    if isinstance(hint, str | typing.ForwardRef):
        return True
    if isinstance(hint, type) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    if isinstance(hint, list | tuple):
        return any(map(_names_axes, hint))
    return any(map(_names_axes, typing.get_args(hint)))
