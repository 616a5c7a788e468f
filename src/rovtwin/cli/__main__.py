"""`python -m rovtwin.cli`."""

from rovtwin.cli import main

main()
