"""`python -m liftdrag` is `liftdrag`."""

from liftdrag.cli import main

main()
