"""The one exception for input that its author can mend."""


class InputError(ValueError):
    """Bad input: its message names the file, the place, the value and the remedy.

    Raised at the boundaries (files, configs, command line) and nowhere else; the command line
    prints it and exits with code 2.  Misuse of the Python API raises plain ``ValueError``.
    """
