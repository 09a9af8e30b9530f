"""`python -m model_runtime age | info | serve`."""

import sys

from .cli import main

sys.exit(main())
