"""``python -m paintit``."""

import sys

from paintit.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
