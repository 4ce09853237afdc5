"""``python -m mbinterval``: the same as the command ``mbinterval``."""

import sys

from mbinterval.cli import main

sys.exit(main())
