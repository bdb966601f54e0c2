"""The one exception of the library: wrong input, named in the user's terms."""


class DenseVSError(ValueError):
    """Input that cannot be used. The message says what was got, what was expected and the valid names.

    Whatever raised it left its state as it was before the call.
    """
