"""`python -m model_runtime age | info | serve`."""

import sys

try:
    from .cli import main

    code = main()
except KeyboardInterrupt:  # before `main` heeds it
    code = 130
sys.exit(code)
