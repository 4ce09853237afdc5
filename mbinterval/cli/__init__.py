"""The command line.

The entry point is `main`; `program` has the options, `commands` what they do.
"""

from mbinterval.cli.program import main

__all__ = ["main"]
