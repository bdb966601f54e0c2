"""What a recording that is being written can hold, and until when: the checks of all writers."""

from typing import Any

from dense_vs.checks import check_names, shown
from dense_vs.errors import DenseVSError

LONGEST_NAME = 256  # characters of a joint's name


def recorded_names(value: Any) -> tuple[str, ...]:
    """Names of joints that come back from a file as they are.

    Raises:
        DenseVSError: no sequence of names, or one that is empty, there twice, longer than 256 characters, or with
            characters that no file can hold.
    """
    names = check_names("joint names", value)
    for name in names:
        if not 0 < len(name) <= LONGEST_NAME or "\0" in name:
            raise DenseVSError(
                f"joint name {shown(name)} cannot be stored; expected 1 to {LONGEST_NAME} characters, none of them null"
            )
        recorded_text("joint name", name)
    if len(set(names)) != len(names):
        twice = next(name for number, name in enumerate(names) if name in names[:number])
        raise DenseVSError(f"joint name {shown(twice)} is there twice; expected each joint a name of its own")
    return names


def recorded_text(name: str, value: Any) -> str:
    """A text that a file can hold.

    Raises:
        DenseVSError: no text, or half of a surrogate pair in it.
    """
    try:
        if isinstance(value, str) and value.encode():
            return value
    except UnicodeEncodeError:
        pass
    raise DenseVSError(f"{name} is {shown(value)}; expected text that UTF-8 has")


def check_open(closed: bool, what: object) -> None:
    """Refuse what comes after a recording's end.

    Raises:
        DenseVSError: it is closed.
    """
    if closed:
        raise DenseVSError(f"{what} is complete; expected nothing more to be added")
