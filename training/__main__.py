"""`python -m training COMMAND`: makes encoders and models of change, and evaluates them."""

from __future__ import annotations

import sys

__all__ = ("main",)


def main() -> int:
    """Run the command line; its exit code. `learn` needs no library of the other commands, which
    are not there where Blender runs it.
    """
    try:
        if sys.argv[1:2] == ["learn"]:
            from .learn_command import main as learn

            return learn(sys.argv[2:])
        from .commands import main as others
    except KeyboardInterrupt:  # before either heeds it
        return 130
    return others()


if __name__ == "__main__":
    sys.exit(main())
