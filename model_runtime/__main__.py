"""`python -m model_runtime age | info | serve`."""

import os
import sys

# Before numpy is imported: products of matrices are small here, and a second thread waits for both.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

try:
    from .cli import main

    code = main()
except KeyboardInterrupt:  # before `main` heeds it
    code = 130
sys.exit(code)
