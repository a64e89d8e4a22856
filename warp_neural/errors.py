"""The one exception for input that a user can mend."""


class InputError(ValueError):
    """Bad input: one line that names the file or option, what is wrong with it, and the remedy."""
