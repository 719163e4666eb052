"""A package, so that `python -m tests...` finds this folder before a dependency that ships a `tests` of its own."""
