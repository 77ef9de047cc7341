"""The one error that means "the user's input is wrong".

Its message is a single line: what is wrong, where (file and key), and what is allowed. The command line
prints it and exits with code 2; everything else that is raised is a bug and keeps its traceback.
"""

from __future__ import annotations


class InputError(ValueError):
    """Bad input: a value, a key, a name or a file that cannot be used, said in one line."""

    def __init__(self, message: str) -> None:
        """An error with `message`, brought to a single line."""
        super().__init__(" ".join(str(message).split()))
