"""`python -m rovtwin.cli`."""

from rovtwin.cli import main

if __name__ == "__main__":
    main()
