"""Every error a user can meet: a stable code, what happened with the offending value, and what to do next."""

from __future__ import annotations


class PaintitError(Exception):
    """Base of all expected failures.

    Args:
        code: stable, machine-readable name such as ``"mesh.empty"``; listed in ``docs/errors.md``.
        message: one sentence, lower case, without a full stop, naming the offending value.
        hint: the next thing to try, in the same style; may be empty.
    """

    exit_code = 1

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        self.code = code
        self.message = message
        self.hint = hint
        super().__init__(f"{message}; {hint}" if hint else message)


class UsageError(PaintitError):
    """The command or call itself is wrong (exit code 2): a flag, a range, an empty prompt."""

    exit_code = 2


class MeshError(PaintitError):
    """The mesh file cannot be read or cannot be painted."""


class LightError(PaintitError):
    """The environment map cannot be read or holds no light."""


class PriorError(PaintitError):
    """The diffusion prior is unknown, absent, or of the wrong kind."""


class OutputError(PaintitError):
    """The result cannot be written."""


class RunError(PaintitError):
    """A run folder is missing, locked, or does not match the request."""


class StudyError(PaintitError):
    """The questions or the answers of a study cannot be used, or its page cannot be served."""


class DownloadError(PaintitError):
    """Files of a public data set cannot be had."""
