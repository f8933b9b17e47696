"""The one error of the library."""


class Error(ValueError):
    """Something that the user gave cannot be used; the message is one clear line.

    It names what was wrong and where (such as `HairType.segments`), the value, and what is allowed.
    """
