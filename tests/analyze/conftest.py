"""The command line's own fixtures serve here too."""

from tests.cli.conftest import cube, here, paintit

__all__ = ["cube", "here", "paintit"]
